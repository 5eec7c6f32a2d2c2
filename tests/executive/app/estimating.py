"""What the tests of the command `estimate` have in common."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Picture

from executive import cli
from executive.domain.loader import load_subject
from tests.executive.s3e.chat_server import ChatServerUnderTest, Request, Response, completion

GROCERY = load_subject("grocery").task
LEMON = ["--problem", "one-item"]
ANSWER = {"question", "prompt", "probability", "yes_mass", "no_mass", "answered"}
Estimate = Callable[..., int]


def say(request: Request) -> Response:
    """Yes to what is about wood, the surer the brighter; no to the rest, but for an empty gripper: neither."""
    if not request.images:
        return completion({"Yes": 0.6, "No": 0.3})
    light = float(np.mean([image.mean() for image in request.images])) / 255
    if "empty" in request.question:
        return completion({"maybe": 0.9, "Yes": 0.05, "No": 0.05})
    yes = 0.4 + 0.5 * light if "wood" in request.question else 0.1
    return completion({" yes": yes / 2, "YES": yes / 2, "No": 0.95 - yes, "well": 0.05})


def printed(capsys: pytest.CaptureFixture[str]) -> Any:
    """The JSON on stdout; stderr says nothing."""
    out, err = capsys.readouterr()
    assert err == ""
    return json.loads(out)


def write_pictures(folder: Path) -> list[Path]:
    """A dark picture and a light one."""
    files = [folder / "dark.png", folder / "light.png"]
    for file, shade in zip(files, (0, 255), strict=True):
        Picture.new("RGB", (16, 12), (shade, shade, shade)).save(file)
    return files


def estimating(server: ChatServerUnderTest) -> Estimate:
    """Runs `executive estimate grocery ...` on the server; the exit code."""

    def run(*arguments: object, domain: object = "grocery") -> int:
        return cli.exit_code(["estimate", str(domain), *map(str, arguments), "--server", server.url])

    return run
