"""Optional libraries by extra, one clear error when one is missing, and the only import of SAPIEN."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from types import MappingProxyType, ModuleType
from typing import Any

from bddl.errors import MissingExtra as MissingExtra
from bddl.errors import install_command as install_command

# Distributions by extra, as in pyproject.toml.
EXTRAS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "sim": ("sapien", "trimesh", "fast-simplification", "example-robot-data"),
        "learn": ("torch", "pytorch-kinematics", "safetensors"),
        "data": ("h5py", "av", "pyarrow", "pyyaml"),
        "gym": ("gymnasium",),
        "llm": ("openai", "pyyaml"),
        "local": ("openai", "pyyaml", "xllamacpp"),
        "mesh": ("coacd", "yourdfpy"),
        "photo": ("embreex", "opencv-python", "shapely"),
        "captures": ("OpenEXR", "lzfse"),
        "vision": ("transformers", "torch", "safetensors"),
        "testing": ("hypothesis",),
        "rerun": ("rerun-sdk",),
        "ray": ("ray",),
    }
)


def require(module: str, extra: str) -> ModuleType:
    """Return an optional library's module.

    Args:
        module: Import name, such as "sapien" or "scipy.spatial".
        extra: The extra that brings it, such as "sim".

    Raises:
        MissingExtra: when it is not installed, or when it cannot be loaded; the message says what to run.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name == module.split(".")[0]:
            raise MissingExtra(module, extra) from error
        raise MissingExtra(module, extra, str(error)) from error
    except (ImportError, OSError) as error:
        raise MissingExtra(module, extra, str(error)) from error


def installed_version(distribution: str) -> str | None:
    """Return a distribution's version, or None when it is not installed; imports nothing."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def missing(extra: str) -> tuple[str, ...]:
    """Return the distributions of an extra that are not installed."""
    return tuple(name for name in EXTRAS[extra] if installed_version(name) is None)


@cache
def load_sapien() -> Any:
    """Return the module `sapien`; everything that needs it takes it from here.

    On many machines SAPIEN warns that it uses the Vulkan loader of its own wheel, which no user can change. That
    warning is suppressed; the process keeps its filters.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Failed to find system libvulkan", category=UserWarning)
        return importlib.import_module("sapien")
