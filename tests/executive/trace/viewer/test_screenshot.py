"""Pictures of a trace, drawn without a screen."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from executive.errors import InputError, MissingError
from executive.trace.viewer.process import ViewerError, headless_viewer, open_window
from executive.trace.viewer.screenshot import screenshot, settle, still
from executive.trace.viewer.sink import RerunSink
from executive.types import Event, Phase
from tests.executive.trace.synthetic import synthetic_events
from tests.executive.trace.viewer.test_sink import written


def can_draw() -> bool:
    from executive.trace.viewer import process

    try:
        process.vulkan()
    except MissingError:
        return False
    return True


draws = pytest.mark.skipif(not can_draw(), reason="no Vulkan driver here: apt-get install -y mesa-vulkan-drivers")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("run"), synthetic_events()).parent


def pixels(png: Path | bytes) -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
    with Picture.open(io.BytesIO(png) if isinstance(png, bytes) else png) as picture:
        return np.asarray(picture.convert("RGB"))


def processes(mark: str) -> list[Path]:
    """The living processes that were started with `mark` in their environment."""
    found = []
    for environment in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):  # it has just ended
            if mark.encode() in environment.read_bytes():
                found.append(environment.parent)
    return found


@draws
def test_a_moment_of_a_run(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STARTED_BY", str(tmp_path))
    assert screenshot(run, tmp_path / "drop.png", at_cycle=2, size=(1200, 800)) == []
    assert screenshot(run, tmp_path / "end.png", size=(1200, 800)) == []
    assert processes(f"STARTED_BY={tmp_path}") == [], "no viewer is left behind"
    drop, end = pixels(tmp_path / "drop.png"), pixels(tmp_path / "end.png")
    assert drop.shape == end.shape == (800, 1200, 3)
    assert (drop != end).any(axis=2).mean() > 0.02, "two moments look different"


@draws
def test_every_panel_shows_something_and_complains_of_nothing(run: Path) -> None:
    with headless_viewer((1600, 1000)) as viewer:
        viewer.open([str(run / "trace.rrd")])
        settle(viewer, run)
        still(viewer)
        views = viewer.get_state().views
        assert {view.name for view in views} >= {
            "scene", "overview", "side", "run", "belief against expectation", "plan", "what was going on", "P(true)",
            "what was believed", "what the last look changed", "decisions and faults",
        }  # fmt: skip
        for view in views:
            assert view.reports == [], view.name
            if view.name == "what the last look changed":  # is behind another one (see `test_one_panel`)
                continue
            inside = pixels(viewer.take_screenshot(view.view_id))
            assert len(np.unique(inside.reshape(-1, 3), axis=0)) > 20, f"{view.name} is empty"


@draws
@pytest.mark.parametrize("panel", ["P(true)", "what the last look changed"])
def test_one_panel(run: Path, tmp_path: Path, panel: str) -> None:
    assert screenshot(run, tmp_path / "panel.png", panel=panel, size=(900, 600)) == []
    drawn = pixels(tmp_path / "panel.png")
    assert abs(drawn.shape[1] - 900) < 20
    assert len(np.unique(drawn.reshape(-1, 3), axis=0)) > 50


@draws
def test_no_panel_of_that_name(run: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no panel 'plam'; did you mean 'plan'"):
        screenshot(run, tmp_path / "no.png", panel="plam")


@draws
def test_a_cycle_that_the_run_did_not_have(run: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no cycle 9; the run has cycles 0 to 8"):
        screenshot(run, tmp_path / "no.png", at_cycle=9)


@draws
def test_a_run_that_was_killed_can_be_drawn(tmp_path: Path) -> None:
    some = [event for event in synthetic_events() if event.cycle <= 2]
    sink = RerunSink(tmp_path)
    for event in some:
        sink.write(event)
    assert screenshot(tmp_path, tmp_path / "cut.png", at_cycle=2) == []


@draws
def test_glyphs_that_the_viewer_lacks_do_not_end_it(tmp_path: Path) -> None:
    first, *rest = synthetic_events("漢字")
    some = [first, Event(0, 0.0, 0.1, Phase("\N{ROBOT FACE}")), *rest]
    written(tmp_path, some)
    assert screenshot(tmp_path, tmp_path / "drawn.png") == []


@draws
def test_what_is_no_trace_is_said_so(tmp_path: Path) -> None:
    (tmp_path / "trace.rrd").write_text("not a trace")
    with pytest.raises(InputError, match=r"trace\.rrd: the viewer cannot read it"):
        screenshot(tmp_path, tmp_path / "no.png")


@draws
def test_a_run_can_be_watched_while_it_goes_on(tmp_path: Path) -> None:
    """And the run does not care when the viewer goes."""
    some = synthetic_events()
    half = len(some) // 2
    with headless_viewer((800, 600)) as viewer:
        sink = RerunSink(tmp_path, viewer=viewer.url)
        for event in some[:half]:
            sink.write(event)
        (recording,) = viewer.get_state().recordings
        assert {line.name for line in recording.timelines} >= {"cycle", "sim_time", "wall"}
    for event in some[half:]:
        sink.write(event)
    sink.close()
    assert screenshot(tmp_path, tmp_path / "end.png") == []


def test_without_a_driver_the_command_that_installs_it_is_named(monkeypatch: pytest.MonkeyPatch, run: Path) -> None:
    for name in ("VK_ICD_FILENAMES", "VK_DRIVER_FILES"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("executive.trace.viewer.process._SOFTWARE_VULKAN", run / "nowhere")
    monkeypatch.setattr("sys.platform", "linux")
    with pytest.raises(MissingError, match="apt-get install -y mesa-vulkan-drivers"):
        screenshot(run, run / "no.png")


def test_without_a_display_there_is_no_window(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("executive.trace.viewer.process.has_display", lambda: False)
    with pytest.raises(ViewerError, match="no display"):
        open_window()
