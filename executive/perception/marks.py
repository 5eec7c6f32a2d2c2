"""Marks: tags that are drawn into pictures beside things that look the same, so that a question can tell which is meant
(set-of-mark prompting: Yang et al., 2023)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from executive.perception.clouds import View
from executive.types import Camera, DepthImage, FloatArray, Image

_HIDDEN = 0.08
"""m that something measured may be in front of an item's middle before the item counts as hidden."""

_SMALLEST, _SHARE = 7, 32
"""Half the height of a tag in pixels, at least, and how many of them are in a picture's height."""


def tags(called: Mapping[str, str]) -> dict[str, str]:
    """Return the tag of each of several things: what they are called, without the words that they all begin with.

    Args:
        called: what each is called in a question, by name; no two the same.
    """
    words = {name: text.split() for name, text in called.items()}
    shared = 0
    while len(words) > 1 and all(len(each) > shared + 1 for each in words.values()):
        if len({each[shared] for each in words.values()}) > 1:
            break
        shared += 1
    return {name: " ".join(each[shared:]) for name, each in words.items()}


def drawn(image: Image, camera: Camera, depth: DepthImage | None, places: Mapping[str, FloatArray]) -> Image:
    """Return a picture with a tag above each of some places that are in it.

    Args:
        image: (H, W, 3), uint8.
        depth: what the same camera measured, to tell what is hidden; None where it measures nothing.
        places: the middle of the tagged thing in m, world frame, (3,), by tag.
    """
    from PIL import Image as Pictures
    from PIL import ImageDraw, ImageFont

    height, width = image.shape[:2]
    measured = np.zeros((camera.height, camera.width), np.uint16) if depth is None else depth
    view = View.of(camera, measured)
    half = max(_SMALLEST, height // _SHARE)
    picture = Pictures.fromarray(image)
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(1.5 * half)
    for tag, place in sorted(places.items()):
        away, pixel, inside = (each[0] for each in view.project(place[None]))
        if not inside or _is_hidden(measured, int(pixel), float(away)):
            continue
        down, right = divmod(int(pixel), camera.width)
        x, y = (right + 0.5) * width / camera.width, (down + 0.5) * height / camera.height
        across = max(float(half), 0.5 * font.getlength(tag) + 0.4 * half)
        # Within the picture, above the thing where there is room.
        left = min(max(x, across), width - 1 - across)
        top = y - 3.0 * half if y >= 4.0 * half else y + 3.0 * half
        pen.line((x, y, left, top), fill="white", width=max(1, half // 5))
        pen.rounded_rectangle((left - across, top - half, left + across, top + half), half, "white", "black")
        pen.text((left, top), tag, "black", font, anchor="mm")
    marked: npt.NDArray[np.uint8] = np.asarray(picture)
    return marked


def _is_hidden(measured: DepthImage, pixel: int, away: float) -> bool:
    """Whether something is in front of the middle of a thing that is `away` m from the camera."""
    millimetres = int(measured.reshape(-1)[pixel])
    return 0 < millimetres < 1000.0 * (away - _HIDDEN)
