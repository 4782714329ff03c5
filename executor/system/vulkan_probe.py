"""List the Vulkan devices of this machine; run as a program, since a broken driver may end its process.

Usage: `python vulkan_probe.py LOADER...`, where each LOADER is a Vulkan loader library to try in turn. Writes
one JSON object: `{"devices": [{"name", "type", "driver_version"}], "problem": "..."}`. Standard library only.
"""

from __future__ import annotations

import ctypes
import json
import re
import sys
from typing import Any

_TYPES = ("other", "integrated", "discrete", "virtual", "cpu")
_PROBLEMS = {-9: "no Vulkan driver is installed", -3: "the Vulkan driver could not be initialised"}
_API_1_1 = (1 << 22) | (1 << 12)
# Values of VkStructureType.
_APPLICATION_INFO, _INSTANCE_CREATE_INFO = 0, 1
_DEVICE_PROPERTIES_2, _DRIVER_PROPERTIES = 1_000_059_001, 1_000_196_000


class _ApplicationInfo(ctypes.Structure):
    _fields_ = (
        ("structure_type", ctypes.c_int),
        ("next", ctypes.c_void_p),
        ("application_name", ctypes.c_char_p),
        ("application_version", ctypes.c_uint32),
        ("engine_name", ctypes.c_char_p),
        ("engine_version", ctypes.c_uint32),
        ("api_version", ctypes.c_uint32),
    )


class _InstanceCreateInfo(ctypes.Structure):
    _fields_ = (
        ("structure_type", ctypes.c_int),
        ("next", ctypes.c_void_p),
        ("flags", ctypes.c_uint32),
        ("application_info", ctypes.POINTER(_ApplicationInfo)),
        ("layer_count", ctypes.c_uint32),
        ("layer_names", ctypes.c_void_p),
        ("extension_count", ctypes.c_uint32),
        ("extension_names", ctypes.c_void_p),
    )


class _DriverProperties(ctypes.Structure):
    _fields_ = (
        ("structure_type", ctypes.c_int),
        ("next", ctypes.c_void_p),
        ("driver", ctypes.c_int),
        ("driver_name", ctypes.c_char * 256),
        ("driver_info", ctypes.c_char * 256),
        ("conformance", ctypes.c_uint8 * 4),
    )


class _DeviceProperties(ctypes.Structure):
    _fields_ = (
        ("structure_type", ctypes.c_int),
        ("next", ctypes.c_void_p),
        ("api_version", ctypes.c_uint32),
        # lavapipe writes 1 here whatever its version; the text in _DriverProperties tells the truth.
        ("driver_version", ctypes.c_uint32),
        ("vendor", ctypes.c_uint32),
        ("device", ctypes.c_uint32),
        ("device_type", ctypes.c_int),
        ("name", ctypes.c_char * 256),
        # The rest (cache id, limits, sparse properties; under 600 bytes) is of no interest here.
        ("rest", ctypes.c_uint64 * 256),
    )


def _devices(loader: ctypes.CDLL) -> list[dict[str, str]]:
    """Return every device that the loader's drivers offer.

    Raises:
        OSError: when no instance can be created, as happens without any driver.
    """
    application = _ApplicationInfo(_APPLICATION_INFO, None, b"scene2demo", 0, b"", 0, _API_1_1)
    info = _InstanceCreateInfo(_INSTANCE_CREATE_INFO, None, 0, ctypes.pointer(application), 0, None, 0, None)
    instance = ctypes.c_void_p()
    result = loader.vkCreateInstance(ctypes.byref(info), None, ctypes.byref(instance))
    if result != 0:
        raise OSError(_PROBLEMS.get(result, f"vkCreateInstance returned {result}"))
    count = ctypes.c_uint32()
    loader.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    handles = (ctypes.c_void_p * count.value)()
    loader.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), handles)
    found = [_describe(loader, ctypes.c_void_p(handle)) for handle in handles[: count.value]]
    loader.vkDestroyInstance(instance, None)
    return found


def _describe(loader: ctypes.CDLL, handle: ctypes.c_void_p) -> dict[str, str]:
    driver = _DriverProperties(_DRIVER_PROPERTIES)
    properties = _DeviceProperties(_DEVICE_PROPERTIES_2, ctypes.addressof(driver))
    loader.vkGetPhysicalDeviceProperties2(handle, ctypes.byref(properties))
    version = re.search(r"\d+(\.\d+)+", driver.driver_info.decode(errors="replace"))
    kind = properties.device_type
    return {
        "name": properties.name.decode(errors="replace"),
        "type": _TYPES[kind] if 0 <= kind < len(_TYPES) else "other",
        "driver_version": version.group() if version else "unknown",
    }


def probe(loaders: list[str]) -> dict[str, Any]:
    """Return the devices that the first loadable loader library lists, or the problem."""
    problem = "no Vulkan loader library was found"
    for path in loaders:
        try:
            return {"devices": _devices(ctypes.CDLL(path)), "problem": ""}
        except (OSError, AttributeError) as error:
            problem = str(error)
    return {"devices": [], "problem": problem}


if __name__ == "__main__":
    sys.stdout.write(json.dumps(probe(sys.argv[1:])))
