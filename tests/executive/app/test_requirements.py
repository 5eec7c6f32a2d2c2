"""What the machine lacks is found before a run starts, and named with the command that mends it."""

from __future__ import annotations

import os
import re
import shlex
import sys
from pathlib import Path

import pytest

from executive.errors import InputError, MissingError
from executive.util import requirements


def test_this_machine_has_all_that_the_tests_need() -> None:
    assert requirements.check() == []
    requirements.require()


@pytest.mark.parametrize("python", [(3, 11), (3, 12), (3, 13)])
def test_supported_pythons(python: tuple[int, int]) -> None:
    assert requirements.wrong_system("linux", python) is None


@pytest.mark.parametrize("python", [(2, 7), (3, 10), (3, 14), (4, 0)])
def test_other_pythons_are_named(python: tuple[int, int]) -> None:
    missing = requirements.wrong_system("linux", python)
    assert missing is not None
    assert f"{python[0]}.{python[1]}" in missing.what
    assert "3.11, 3.12, 3.13" in missing.what


def test_windows_is_sent_to_wsl() -> None:
    missing = requirements.wrong_system("win32", (3, 12))
    assert missing is not None
    assert "WSL2" in missing.what
    assert missing.command == "wsl --install"


def test_the_supported_pythons_are_those_of_the_package() -> None:
    """pyproject.toml says them once more, for pip."""
    pyproject = (Path(requirements.__file__).parents[2] / "pyproject.toml").read_text()
    oldest, too_new = (".".join(map(str, version)) for version in requirements.PYTHONS)
    assert f'requires-python = ">={oldest},<{too_new}"' in pyproject


def test_missing_packages_come_with_one_pip_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        requirements, "PACKAGES", {"no_such_module_a": "robosuite", "no_such_module_b": "somewhere-else"}
    )
    (missing,) = requirements.missing_packages()
    assert missing.what == "the Python packages robosuite, somewhere-else are missing"
    command = shlex.split(missing.command)
    assert command[:4] == [sys.executable, "-m", "pip", "install"]
    assert command[4:] == ["robosuite==1.5.1", "somewhere-else"]


def test_on_arm_linux_fast_downward_is_built_from_source(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requirements, "PACKAGES", {"no_such_module": "up-fast-downward"})
    monkeypatch.setattr("platform.machine", lambda: "aarch64")
    monkeypatch.setattr("sys.platform", "linux")
    (missing,) = requirements.missing_packages()
    assert missing.command.endswith(requirements.ENGINE_SOURCE)


def test_a_partial_installation_is_reinstalled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requirements, "ENGINE", "no/such/file")
    (missing,) = requirements.missing_parts()
    assert missing.what.startswith("Fast Downward's search engine is missing (")
    assert "--force-reinstall" in missing.command


@pytest.mark.skipif(sys.platform != "linux", reason="system libraries are probed on Linux alone")
def test_system_libraries_come_with_one_apt_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requirements, "LIBRARIES", {"libnosuchthing.so.7": "libnosuchthing7"})
    monkeypatch.setattr(requirements, "egl_trouble", lambda: "EGL (no graphics driver)")
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    (missing,) = requirements.missing_libraries()
    assert missing.what == "cannot use libnosuchthing.so.7, EGL (no graphics driver)"
    assert missing.command == ("sudo apt-get update && sudo apt-get install -y libnosuchthing7 libegl1 libgl1-mesa-dri")


@pytest.mark.skipif(sys.platform != "linux", reason="system libraries are probed on Linux alone")
def test_egl_is_not_asked_for_where_another_renderer_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requirements, "egl_trouble", lambda: "EGL")
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.setenv("DISPLAY", ":0")
    assert requirements.missing_libraries() == []


@pytest.fixture
def blank(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """An environment in which nothing is said of what draws."""
    for name in (requirements.RENDERER, requirements.BINDING, requirements.DEVICE, "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.setenv(name, "")
    return monkeypatch


@pytest.mark.skipif(sys.platform != "linux", reason="there is more than one renderer on Linux alone")
@pytest.mark.parametrize("said", ["", "egl", " EGL\t", "osmesa"])
@pytest.mark.parametrize("binding", ["", "same", " SAME "])
def test_what_draws_is_written_as_mujoco_and_opengl_read_it(said: str, binding: str, blank: pytest.MonkeyPatch) -> None:
    renderer = said.strip().lower() or "egl"
    written = binding.replace("same", renderer).replace("SAME", renderer.upper())
    blank.setenv(requirements.RENDERER, said)
    blank.setenv(requirements.BINDING, written)
    assert requirements.choose_renderer() == renderer
    assert os.environ[requirements.RENDERER] == renderer
    assert os.environ[requirements.BINDING] == written.strip().lower()


@pytest.mark.skipif(sys.platform != "linux", reason="there is more than one renderer on Linux alone")
@pytest.mark.parametrize(
    ("name", "said"),
    [
        *(
            (requirements.RENDERER, said)
            for said in ("elg", "off", "0", "disable", "wgl", "e g l", "glfw", "glx", "on")
        ),
        *((requirements.BINDING, said) for said in ("glx", "osmesa", "nonsense")),
    ],
)
def test_a_variable_with_which_nothing_can_be_drawn_is_refused_by_name(
    name: str, said: str, blank: pytest.MonkeyPatch
) -> None:
    blank.setenv(name, said)
    with pytest.raises(InputError, match=re.escape(repr(said))) as raised:
        requirements.require()
    assert raised.value.key == name
    assert "install" not in str(raised.value)


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is asked on Linux alone")
@pytest.mark.parametrize("said", ["x", "99", "-1", "0.5"])
def test_a_device_that_is_not_there_is_refused_by_name(said: str, blank: pytest.MonkeyPatch) -> None:
    blank.setenv(requirements.DEVICE, said)
    with pytest.raises(InputError, match=re.escape(repr(said))) as raised:
        requirements.egl_trouble()
    assert raised.value.key == requirements.DEVICE


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is asked on Linux alone")
def test_a_device_of_no_name_is_any(blank: pytest.MonkeyPatch) -> None:
    assert requirements.egl_trouble() is None
    assert requirements.DEVICE not in os.environ  # which MuJoCo would take for a number


@pytest.mark.parametrize(
    ("name", "kind"), [("LIBGL_DRIVERS_PATH", InputError), ("GALLIUM_DRIVER", InputError), (None, MissingError)]
)
def test_what_may_lead_opengl_astray_is_named_before_anything_is_to_be_installed(
    name: str | None, kind: type[Exception], blank: pytest.MonkeyPatch
) -> None:
    if name is not None:
        blank.setenv(name, "nonsense")
    error = requirements.cannot_draw("no driver")
    assert type(error) is kind
    assert name is None or f"{name}=nonsense" in str(error)


def test_everything_missing_is_one_error(monkeypatch: pytest.MonkeyPatch) -> None:
    lacks = [
        requirements.Missing("a is missing", "get a"),
        requirements.Missing("b", "get b"),
        requirements.Missing("c", "get a"),
    ]
    monkeypatch.setattr(requirements, "check", lambda: lacks)
    with pytest.raises(MissingError) as raised:
        requirements.require()
    assert str(raised.value) == "a is missing; b; c; install it with: get a && get b"
    assert raised.value.exit_code == 3
