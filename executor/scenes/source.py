"""Scenes by name or by file, the way that people name them on a command line."""

from __future__ import annotations

from pathlib import Path

from executor.scenes import library
from executor.scenes.cousins import from_cousins, holds_cousins
from oag import Scene


def load_scene(name_or_path: str | Path) -> Scene:
    """Returns a scene of the package by its name, or the scene of a JSON file.

    Anything that ends in `.json`, has a folder in it, or exists as a file is taken for a file. A file of Digital
    Cousins (`scene_0_info.json`) is furnished with the library's models; see `executor.scenes.cousins`.

    Raises:
        SceneNotFound: When the package has no scene of that name; the message has the near ones.
        SceneError: When the file is missing or malformed.
    """
    if is_file(name_or_path):
        path = Path(name_or_path)
        return from_cousins(path).scene if holds_cousins(path) else Scene.from_json(path)
    return library.load(str(name_or_path))


def is_file(name_or_path: str | Path) -> bool:
    """Decides whether a scene is named by its file."""
    path = Path(name_or_path)
    named = isinstance(name_or_path, Path) or path.suffix == ".json" or len(path.parts) > 1
    return named or path.is_file() or path.is_fifo()
