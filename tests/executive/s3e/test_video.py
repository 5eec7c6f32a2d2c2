"""Frames of a video: the ones that are asked for, and one line for whatever is no video."""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from executive.errors import InputError, MissingError
from executive.s3e import video
from executive.s3e.video import read_frames
from tests.executive.s3e.videos import greys, write_video


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds, ten frames a second."""
    return write_video(tmp_path_factory.mktemp("video") / "clip.mp4", greys(20))


def test_a_frame_every_half_second(clip: Path) -> None:
    frames = list(read_frames(clip, 0.5))
    assert [time for time, _ in frames] == pytest.approx([0.0, 0.5, 1.0, 1.5])
    assert [round(image.mean() / 10) for _, image in frames] == [0, 5, 10, 15]
    assert {image.shape for _, image in frames} == {(48, 64, 3)}
    assert {image.dtype for _, image in frames} == {np.dtype(np.uint8)}


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(every=st.floats(0.01, 3.0))
def test_never_a_frame_too_early_nor_one_left_out(clip: Path, every: float) -> None:
    times = [time for time, _ in read_frames(clip, every)]
    assert times[0] == 0.0
    assert times == sorted(set(times))
    for earlier, later in pairwise(times):
        due = every * (1 + np.floor((earlier + 1e-6) / every))
        assert due - 1e-5 <= later <= due + 0.1 + 1e-5  # the frames are 0.1 s apart
    assert times[-1] + max(every, 0.1) > 1.9 - 1e-5


def test_seconds_are_since_the_first_frame(clip: Path, tmp_path: Path) -> None:
    import av

    late = tmp_path / "late.mkv"
    with av.open(str(clip)) as source, av.open(str(late), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(source.streams.video[0]):
            if packet.pts is not None and packet.dts is not None and packet.time_base is not None:
                packet.pts += int(5 / packet.time_base)
                packet.dts += int(5 / packet.time_base)
                packet.stream = stream
                target.mux(packet)
    assert [time for time, _ in read_frames(late, 0.5)] == pytest.approx([0.0, 0.5, 1.0, 1.5])


def test_a_phone_held_upright_gives_upright_frames() -> None:
    lying = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    frame: Any = SimpleNamespace(rotation=-90, to_ndarray=lambda format: lying)
    assert np.array_equal(video._picture(frame), np.rot90(lying, -1))
    frame.rotation = 180
    assert np.array_equal(video._picture(frame), lying[::-1, ::-1])


def test_what_is_no_video_is_one_line(clip: Path, tmp_path: Path) -> None:
    whole = clip.read_bytes()
    bad = {
        "text.mp4": b"hello, I am no video",
        "empty.mp4": b"",
        "cut.mp4": whole[: len(whole) // 2],
        "list.m3u8": b"#EXTM3U\n#EXTINF:10,\nhttp://127.0.0.1:9/frames.ts\n#EXT-X-ENDLIST\n",
        "concat.txt": b"ffconcat version 1.0\nfile /etc/hostname\n",
    }
    for name, data in bad.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(InputError) as caught:
            list(read_frames(tmp_path / name, 0.5))
        assert str(caught.value).startswith(f"{tmp_path / name}: ")
    for path, said in ((tmp_path, "is a folder"), (tmp_path / "nothing.mp4", "there is no such file")):
        with pytest.raises(InputError, match=said):
            read_frames(path, 0.5)


def test_a_playlist_reads_no_other_file(clip: Path, tmp_path: Path) -> None:
    playlist = tmp_path / "list.m3u8"
    playlist.write_text(f"#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:10,\n{clip}\n#EXT-X-ENDLIST\n")
    with pytest.raises(InputError):
        list(read_frames(playlist, 0.5))


def test_sound_alone_is_no_video(tmp_path: Path) -> None:
    import av

    sound = tmp_path / "sound.mkv"
    with av.open(str(sound), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
        frame.sample_rate = 8000
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.raises(InputError, match="has no pictures in it"):
        list(read_frames(sound, 0.5))


def test_frames_that_are_too_large_are_not_read(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video, "LARGEST", 1000)
    with pytest.raises(InputError, match="more than 1,000 pixels"):
        list(read_frames(clip, 0.5))


@pytest.mark.parametrize("every", [0.0, -1.0, float("nan")])
def test_no_time_between_frames_is_one_line(clip: Path, every: float) -> None:
    with pytest.raises(InputError, match="every"):
        read_frames(clip, every)


def test_without_pyav_the_extra_is_named(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingError) as caught:
        read_frames(clip, 0.5)
    assert "pip install 'executive[video]'" in str(caught.value)
