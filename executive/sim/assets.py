"""robosuite's asset files as MuJoCo specs. They are read from the installed package without importing it, which would
take seconds and load numba, OpenCV and an input-device listener for nothing."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from executive.errors import MissingError


@cache
def folder() -> Path:
    """Where robosuite keeps its models.

    Raises:
        MissingError: robosuite is not installed.
    """
    found = importlib.util.find_spec("robosuite")
    if found is None or found.origin is None:
        raise MissingError(
            "robosuite, whose robot and groceries the scene is made of, is not installed",
            command="pip install robosuite==1.5.1",
        )
    return Path(found.origin).parent / "models" / "assets"


def texture(name: str) -> str:
    return str(folder() / "textures" / name)


def load(relative: str) -> mujoco.MjSpec:
    """One asset file as a spec that can be attached anywhere: file names absolute, names unique."""
    path = folder() / relative
    tree = ElementTree.parse(path)
    root = tree.getroot()
    if root.find("compiler") is None:
        # robosuite merges its files into a base that says so; on its own a file would be read in degrees.
        ElementTree.SubElement(root, "compiler", angle="radian")
    taken: set[str] = set()
    for asset in root.iter("asset"):
        for element in list(asset):
            name = f"{element.tag}/{element.get('name')}"
            if name in taken:
                # The Robotiq file names a second base mesh like the first one; its file is not shipped.
                asset.remove(element)
                continue
            taken.add(name)
            file = element.get("file")
            if file is not None:
                element.set("file", str((path.parent / file).resolve()))
    return mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
