"""The ROS 2 messages that a run is exported as: their definitions, and what is made of ours.

Definitions are in the form in which MCAP files carry them: the message's fields, then those of each message inside it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from executive.types import FloatArray

Message = dict[str, Any]

_TIME = "int32 sec\nuint32 nanosec"
_HEADER = "builtin_interfaces/Time stamp\nstring frame_id"
_VECTOR = "float64 x\nfloat64 y\nfloat64 z"
_QUATERNION = "float64 x\nfloat64 y\nfloat64 z\nfloat64 w"
_TRANSFORM = "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
_STAMPED = "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
_STATUS = "byte level\nstring name\nstring message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values"
_REGION = "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify"
_CAMERA = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n"
    "float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi"
)
_JOINTS = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"


def _definition(fields: str, **inside: str) -> str:
    parts = [f"{'=' * 80}\nMSG: {name.replace('__', '/')}\n{text}" for name, text in inside.items()]
    return "\n".join([fields, *parts])


_STAMP = {"std_msgs__Header": _HEADER, "builtin_interfaces__Time": _TIME}
_SPACE = {"geometry_msgs__Vector3": _VECTOR, "geometry_msgs__Quaternion": _QUATERNION}

IMAGE, CAMERA, JOINTS = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/JointState"
TRANSFORMS, DIAGNOSTICS = "tf2_msgs/msg/TFMessage", "diagnostic_msgs/msg/DiagnosticArray"

DEFINITIONS: Mapping[str, str] = {
    IMAGE: _definition("std_msgs/Header header\nstring format\nuint8[] data", **_STAMP),
    CAMERA: _definition(_CAMERA, sensor_msgs__RegionOfInterest=_REGION, **_STAMP),
    JOINTS: _definition(_JOINTS, **_STAMP),
    TRANSFORMS: _definition(
        "geometry_msgs/TransformStamped[] transforms",
        geometry_msgs__TransformStamped=_STAMPED,
        geometry_msgs__Transform=_TRANSFORM,
        **_SPACE,
        **_STAMP,
    ),
    DIAGNOSTICS: _definition(
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status",
        diagnostic_msgs__DiagnosticStatus=_STATUS,
        diagnostic_msgs__KeyValue="string key\nstring value",
        **_STAMP,
    ),
}
"""By the messages' types."""

OK, WARN, ERROR = range(3)
"""Levels of a diagnostic status."""


def header(nanoseconds: int, frame: str = "") -> Message:
    """The stamp of a message, and the frame that it is in."""
    seconds, rest = divmod(nanoseconds, 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}


def transform(nanoseconds: int, child: str, pose: Sequence[float] | FloatArray, parent: str = "world") -> Message:
    """Where `child` is: `pose` is (7,), position in m and quaternion (w, x, y, z), in the frame `parent`."""
    x, y, z, w, i, j, k = (float(number) for number in pose)
    return {
        "header": header(nanoseconds, parent),
        "child_frame_id": child,
        "transform": {"translation": {"x": x, "y": y, "z": z}, "rotation": {"x": i, "y": j, "z": k, "w": w}},
    }


def joint_state(nanoseconds: int, names: Sequence[str], positions: Iterable[float]) -> Message:
    """Joint positions in rad, or m where a joint slides."""
    there = [float(position) for position in positions]
    return {"header": header(nanoseconds), "name": [*names], "position": there, "velocity": [], "effort": []}


def status(level: int, name: str, message: str, values: Mapping[str, str]) -> Message:
    """One diagnostic status."""
    told = [{"key": key, "value": value} for key, value in values.items()]
    return {"level": level, "name": name, "message": message, "hardware_id": "executive", "values": told}
