"""Asks Vulkan, which the viewer draws with, for its devices, and prints them as a JSON array of `[name, kind]`.

    python -m executive.trace.viewer.vulkan_probe

A program of its own, because a broken graphics driver may take the process with it (see `executive.app.doctor`).
"""

from __future__ import annotations

import ctypes
import json
import os
import sys

from executive.trace.viewer.process import vulkan

LIBRARY = {"darwin": "libvulkan.1.dylib"}.get(sys.platform, "libvulkan.so.1")
KINDS = ("other", "integrated", "discrete", "virtual", "software")
"""What a device says it is: VkPhysicalDeviceType 0 to 4."""

_NAME, _NAME_LENGTH, _KIND, _SIZE = 20, 256, 16, 4096
"""Offsets into VkPhysicalDeviceProperties, and more bytes than it has."""


class _InstanceInfo(ctypes.Structure):
    """VkInstanceCreateInfo: an instance that needs nothing."""

    _fields_ = (
        ("type", ctypes.c_int),
        ("next", ctypes.c_void_p),
        ("flags", ctypes.c_uint32),
        ("application", ctypes.c_void_p),
        ("layers", ctypes.c_uint32),
        ("layer_names", ctypes.c_void_p),
        ("extensions", ctypes.c_uint32),
        ("extension_names", ctypes.c_void_p),
    )


def devices() -> list[tuple[str, str]]:
    """Return the name and the kind (one of `KINDS`) of every device.

    Raises:
        OSError: there is no Vulkan library, or no driver for it.
    """
    loader = ctypes.CDLL(LIBRARY)
    instance = ctypes.c_void_p()
    code = loader.vkCreateInstance(ctypes.byref(_InstanceInfo(type=1)), None, ctypes.byref(instance))
    if code != 0:
        raise OSError(f"Vulkan has no driver that works (VkResult {code})")
    count = ctypes.c_uint32(16)
    handles = (ctypes.c_void_p * count.value)()
    loader.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), handles)
    found = []
    for handle in handles[: count.value]:
        properties = ctypes.create_string_buffer(_SIZE)
        loader.vkGetPhysicalDeviceProperties(ctypes.c_void_p(handle), properties)
        kind = int.from_bytes(properties.raw[_KIND : _KIND + 4], sys.byteorder)
        name = properties.raw[_NAME : _NAME + _NAME_LENGTH].split(b"\0")[0].decode(errors="replace")
        found.append((name, KINDS[kind] if kind < len(KINDS) else KINDS[0]))
    loader.vkDestroyInstance(instance, None)
    return found


if __name__ == "__main__":
    os.environ.update(vulkan())  # as the viewer is started with
    print(json.dumps(devices()))
