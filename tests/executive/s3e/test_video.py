"""Frames of a video: the ones that are asked for, and one line for whatever is no video."""

from __future__ import annotations

import struct
import sys
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

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


MATRICES = {
    90: (0, 1, 0, -1, 0, 0, 0, 0),
    180: (-1, 0, 0, 0, -1, 0, 0, 0),
    270: (0, -1, 0, 1, 0, 0, 0, 0),
}
"""Display matrices of an MP4 track for turns clockwise, in degrees."""


@pytest.mark.parametrize("clockwise", MATRICES)
def test_a_phone_held_upright_gives_upright_frames(tmp_path: Path, clockwise: int) -> None:
    """The frames lie in the file, and a display matrix says how they are to be turned."""
    lying = np.zeros((48, 64, 3), np.uint8)
    lying[:24] = 255
    data = bytearray(write_video(tmp_path / "lying.mp4", [lying] * 3).read_bytes())
    at = data.index(b"tkhd") + 44  # after version, times, track, duration, layer, group and volume
    data[at : at + 36] = struct.pack(">9i", *(65536 * value for value in MATRICES[clockwise]), 1 << 30)
    turned = tmp_path / "turned.mp4"
    turned.write_bytes(data)
    [(_, frame), *_] = list(read_frames(turned, 0.1))
    wanted = np.rot90(lying, -clockwise // 90)
    assert frame.shape == wanted.shape
    assert np.abs(frame.astype(int) - wanted).mean() < 8, "but for what the coding spoils at the edge"


def test_frames_of_uneven_length_keep_their_times(tmp_path: Path) -> None:
    """As phones write them: a frame is shown until the next one comes."""
    import av

    file, times = tmp_path / "uneven.mkv", (0.0, 0.04, 0.5, 0.51, 1.7, 1.733)
    with av.open(str(file), "w") as container:
        stream = container.add_stream("mpeg4", rate=1000)
        stream.width, stream.height, stream.pix_fmt, stream.time_base = 64, 48, "yuv420p", Fraction(1, 1000)
        for shade, time in zip(greys(len(times)), times, strict=True):
            frame = av.VideoFrame.from_ndarray(shade, format="rgb24")
            frame.pts, frame.time_base = round(1000 * time), Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    every = list(read_frames(file, 0.001))
    assert [time for time, _ in every] == pytest.approx(times)
    assert [round(image.mean() / 10) for _, image in every] == list(range(len(times)))
    assert [time for time, _ in read_frames(file, 0.5)] == pytest.approx([0.0, 0.5, 1.7])


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
