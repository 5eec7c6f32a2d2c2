"""A behaviour tree as XML of BehaviorTree.CPP 4."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

from executive.errors import InputError
from executive.export.behaviour_trees import Node, NodeKind
from executive.types import Step
from executive.util.atomic_write import write_atomic
from executive.util.files import reason

MAIN = "Plan"
_SKILL = "Skill_"
_TAGS = {NodeKind.SEQUENCE: "Sequence", NodeKind.FALLBACK: "Fallback", NodeKind.RETRY: "RetryUntilSuccessful"}
_LEAVES = {
    NodeKind.LOOK: ("Action", "Look"),
    NodeKind.HOLDS: ("Condition", "Holds"),
    NodeKind.HOLDS_NOT: ("Condition", "HoldsNot"),
}
_RESERVED = frozenset({"id", "name", "type", "root"})


def btcpp_xml(tree: Node, parameters: Mapping[str, tuple[str, ...]] | None = None) -> str:
    """A behaviour tree as XML that BehaviorTree.CPP loads (`BTCPP_format="4"`).

    Its leaves are nodes for the user to register: `Look`, which observes; `Holds` and `HoldsNot`, which succeed where
    the atom that is their name is known to be true, or false; and for each action NAME `Skill_NAME`, in a subtree of
    the action's name that has the step's arguments on its blackboard.

    Args:
        parameters: action -> the names of its parameters; without them they are `arg1`, `arg2` ...
    """
    root = ET.Element("root", BTCPP_format="4", main_tree_to_execute=MAIN)
    _add(ET.SubElement(root, "BehaviorTree", ID=MAIN), tree, parameters or {})
    model = ET.Element("TreeNodesModel")
    steps = {node.step.action: node.step for node in tree.walk() if node.step is not None}
    for action, step in sorted(steps.items()):
        stub = ET.SubElement(root, "BehaviorTree", ID=action)
        ET.SubElement(stub, "Action", ID=f"{_SKILL}{action}", name=action)
        ports = ET.SubElement(model, "SubTree", ID=action)
        for port in _ports(step, parameters or {}):
            ET.SubElement(ports, "input_port", name=port, type="std::string")
        ET.SubElement(model, "Action", ID=f"{_SKILL}{action}")
    for tag, leaf in _LEAVES.values():
        ET.SubElement(model, tag, ID=leaf)
    root.append(model)
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def write_btcpp(file: Path | str, tree: Node, parameters: Mapping[str, tuple[str, ...]] | None = None) -> Path:
    """Write `btcpp_xml` to a file, whole or not at all, and return its path.

    Raises:
        InputError: the file cannot be written.
    """
    path = Path(file)
    try:
        return write_atomic(path, btcpp_xml(tree, parameters).encode())
    except OSError as error:
        raise InputError(f"cannot be written ({reason(error)})", file=path) from None


def _add(parent: ET.Element, node: Node, parameters: Mapping[str, tuple[str, ...]]) -> None:
    if node.kind in _LEAVES:
        tag, leaf = _LEAVES[node.kind]
        ET.SubElement(parent, tag, ID=leaf, name=node.name)
    elif node.step is not None:
        arguments = dict(zip(_ports(node.step, parameters), node.step.args, strict=True))
        ET.SubElement(parent, "SubTree", {"ID": node.step.action, "name": node.name, **arguments})
    else:
        element = ET.SubElement(parent, _TAGS.get(node.kind, "ForceSuccess"), name=node.name)
        if node.kind is NodeKind.RETRY:
            element.set("num_attempts", str(node.attempts))
        for child in node.children:
            _add(element, child, parameters)


def _ports(step: Step, parameters: Mapping[str, tuple[str, ...]]) -> list[str]:
    """The names by which a step's arguments are on its subtree's blackboard: letters, digits and `_`, none twice."""
    named = parameters.get(step.action, ())
    if len(named) != len(step.args):
        named = tuple(f"arg{number}" for number in range(1, len(step.args) + 1))
    ports: list[str] = []
    for name in named:
        port = re.sub(r"\W", "_", name, flags=re.ASCII)
        port = f"{port}_" if port.lower() in _RESERVED or not port[0].isalpha() else port
        while port in ports:
            port += "_"
        ports.append(port if port[0].isalpha() else f"arg{port}")
    return ports
