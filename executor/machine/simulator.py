"""The simulator's module, imported in this one place."""

from __future__ import annotations

import importlib
import warnings
from functools import cache
from typing import Any


@cache
def load_sapien() -> Any:
    """Returns the module `sapien`; everything that needs it takes it from here.

    It warns on many machines that it uses the Vulkan loader of its own wheel, with which nobody can do anything. That
    is left out, and the process keeps its filters.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Failed to find system libvulkan", category=UserWarning)
        return importlib.import_module("sapien")
