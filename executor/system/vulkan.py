"""Find a Vulkan driver that SAPIEN can draw with, and switch this process to it.

Physics needs no driver. Cameras do: a graphics card's, or a recent lavapipe, Mesa's software renderer.
`scripts/setup_renderer.py` puts lavapipe beside the Python environment when the machine has no suitable driver.
A program that draws calls `activate()` before it makes its first camera.
"""

from __future__ import annotations

import ctypes
import importlib.util
import json
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

from bddl.errors import Scene2DemoError

LAVAPIPE_MINIMUM = (24, 3)
MANIFEST_NAME = "renderer.json"
_DRIVER_VARIABLES = ("VK_DRIVER_FILES", "VK_ICD_FILENAMES")
_PROBE_TIMEOUT_S = 60.0
_REMEDY = (
    "Run `make repair` in the checkout, or install a Vulkan driver (on Debian: mesa-vulkan-drivers, version "
    f"{'.'.join(map(str, LAVAPIPE_MINIMUM))} or newer). Everything but the cameras works without one."
)

# Libraries stay open as long as the process lives; the driver is linked against them by name.
_preloaded: dict[Path, ctypes.CDLL] = {}


@dataclass(frozen=True, slots=True)
class Device:
    """One Vulkan device: its name, its type ("cpu", "discrete", ...) and its driver's version."""

    name: str
    type: str
    driver_version: str

    @property
    def draws(self) -> bool:
        """True when SAPIEN can draw on it: any graphics device, or lavapipe from `LAVAPIPE_MINIMUM` on."""
        return self.type != "cpu" or version_tuple(self.driver_version) >= LAVAPIPE_MINIMUM


@dataclass(frozen=True, slots=True)
class Renderer:
    """The driver that this machine draws with, or why there is none.

    Attributes:
        kind: "private" for the driver beside this environment, "system" for one of the machine's, or "none".
        why: Message for a person: what was chosen, or what is missing.
        remedy: What to do about it; empty when there is nothing to do.
    """

    kind: Literal["system", "private", "none"]
    why: str
    remedy: str = ""

    def __bool__(self) -> bool:
        return self.kind != "none"


class RendererNotFound(Scene2DemoError):
    """Nothing on this machine can draw.

    Its only argument is its message, so that it passes between processes unchanged.
    """

    @classmethod
    def of(cls, renderer: Renderer) -> RendererNotFound:
        """Return the error for a renderer of kind "none": its reason and its remedy."""
        return cls(f"Nothing here can draw pictures: {renderer.why}. {renderer.remedy}")


def version_tuple(text: str) -> tuple[int, ...]:
    """Return the leading numbers of a version, so that "25.0.7-2" compares as (25, 0, 7)."""
    leading = re.match(r"\d+(?:\.\d+)*", text)
    return tuple(int(part) for part in leading.group().split(".")) if leading else ()


def private_prefix() -> Path:
    """Return the folder where this environment keeps its own driver."""
    return Path(sys.prefix) / "share" / "scene2demo" / "vulkan"


def probe_devices() -> tuple[tuple[Device, ...], str]:
    """Return the Vulkan devices of this machine and, when there are none, the reason.

    A child process queries them, since a broken driver can end the process that loads it.
    """
    program = Path(__file__).with_name("vulkan_probe.py")
    command = [sys.executable, "-I", "-S", str(program), *_loader_libraries()]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PROBE_TIMEOUT_S, check=False)
        answer = json.loads(done.stdout) if done.returncode == 0 else None
    except (subprocess.TimeoutExpired, ValueError):
        answer = None
    if answer is None:
        return (), "the Vulkan driver ended or blocked the process that asked it for its devices"
    devices = tuple(Device(d["name"], d["type"], d["driver_version"]) for d in answer["devices"])
    return devices, answer["problem"] or ("" if devices else "the Vulkan loader found no driver")


def _loader_libraries() -> tuple[str, ...]:
    """Return Vulkan loaders to try in turn: the system's, then the one inside the SAPIEN wheel."""
    spec = importlib.util.find_spec("sapien")
    folders = spec.submodule_search_locations or [] if spec else []
    bundled = [str(path) for f in folders for path in sorted(Path(f).glob("vulkan_library/libvulkan.so.*"))]
    return ("libvulkan.so.1", *bundled)


@dataclass(frozen=True, slots=True)
class _Private:
    """The driver beside this environment, as its manifest describes it."""

    icd: Path
    version: str
    preload: tuple[Path, ...]


def _read_private(prefix: Path) -> _Private | None:
    """Return the private driver under `prefix`, or None when it is absent or not all there."""
    try:
        described = json.loads((prefix / MANIFEST_NAME).read_text(encoding="utf-8"))
        found = _Private(
            icd=prefix / described["icd"],
            version=described["version"],
            preload=tuple(prefix / name for name in described["preload"]),
        )
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return found if all(path.is_file() for path in (found.icd, *found.preload)) else None


def find_renderer() -> Renderer:
    """Return what to draw with: a driver named by the environment, else the private one, else the machine's.

    Drivers named in `VK_DRIVER_FILES` or `VK_ICD_FILENAMES` are the user's choice. They need not be the best ones,
    or as new as `LAVAPIPE_MINIMUM`, but they have to offer a device.
    """
    private = _read_private(private_prefix())
    variable = next((name for name in _DRIVER_VARIABLES if os.environ.get(name)), None)
    if variable is not None and (private is None or os.environ[variable] != str(private.icd)):
        return _named_renderer(variable, os.environ[variable])
    if private is not None:
        return Renderer("private", f"Mesa lavapipe {private.version}, installed beside this Python environment")
    return _system_renderer()


@cache
def _named_renderer(variable: str, named: str) -> Renderer:
    """Return the drivers that a variable of the environment lists, or why none of them will do."""
    absent = [path for path in named.split(os.pathsep) if path and not Path(path).exists()]
    devices, problem = probe_devices()
    if devices:
        return Renderer("system", f"named in the environment: {named}")
    why = f"{', '.join(absent)} does not exist" if len(absent) == 1 else f"{', '.join(absent)} do not exist"
    listed = f"{variable} lists {named}, and {why if absent else 'no driver is found there'}"
    if not absent and problem:
        listed += f" ({problem})"
    remedy = f"Unset {variable}, or list the JSON manifests of Vulkan drivers in it, with {os.pathsep!r} between them."
    return Renderer("none", listed, remedy)


@cache
def _system_renderer() -> Renderer:
    """Return the best of the machine's own devices, or the reason why none of them will do."""
    devices, problem = probe_devices()
    drawing = sorted((d for d in devices if d.draws), key=lambda d: d.type == "cpu")
    if drawing:
        best = drawing[0]
        return Renderer("system", f"{best.name}, driver {best.driver_version}")
    if devices:
        wanted = ".".join(map(str, LAVAPIPE_MINIMUM))
        old = ", ".join(f"{d.name} with driver {d.driver_version}" for d in devices)
        problem = f"{old} is older than lavapipe {wanted}, which SAPIEN needs"
    return Renderer("none", problem, _REMEDY)


def activate() -> Renderer:
    """Switch this process, and the processes it starts, to a driver that draws; return which one.

    Call it before the first render system, camera or `sapien.Device` is made: the first of them fixes the driver
    for the life of the process. Importing SAPIEN does not. Calling this again changes nothing.

    Raises:
        RendererNotFound: when nothing on this machine can draw; the message says what to do.
    """
    renderer = find_renderer()
    if not renderer:
        raise RendererNotFound.of(renderer)
    private = _read_private(private_prefix())
    if renderer.kind == "private" and private is not None:
        os.environ.update(dict.fromkeys(_DRIVER_VARIABLES, str(private.icd)))
        for path in private.preload:
            if path not in _preloaded:
                _preloaded[path] = ctypes.CDLL(str(path))
    return renderer
