"""Scenes by name or by file, the way that people name them on a command line; some come with the package."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path

from bddl import near_names
from executor.scenes.cousins import Converted, from_cousins, holds_cousins
from oag import Scene

_DATA = resources.files(__package__) / "data"


class SceneNotFound(LookupError):
    """No scene of this name comes with the package."""

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        self.name = name
        self.near = tuple(near_names(name, known))
        hint = f"did you mean {' or '.join(self.near)}? " if self.near else ""
        super().__init__(f"there is no scene {name!r}; {hint}the scenes are {', '.join(known)}")


def names() -> tuple[str, ...]:
    """Returns the names of all scenes that come with the package, sorted."""
    return tuple(sorted(entry.name[:-5] for entry in _DATA.iterdir() if entry.name.endswith(".json")))


def load(name: str) -> Scene:
    """Returns a scene of the package, as it is written (objects at their original size, nothing varied).

    Raises:
        SceneNotFound: When there is none of that name; the message has the near ones.
    """
    known = names()
    if name not in known:
        raise SceneNotFound(name, known)
    return Scene.from_json(json.loads((_DATA / f"{name}.json").read_text(encoding="utf-8")))


def load_scene(name_or_path: str | Path) -> Scene:
    """Returns a scene of the package by its name, or the scene of a JSON file.

    Anything that ends in `.json`, has a folder in it, or exists as a file is taken for a file. A file of Digital
    Cousins (`scene_0_info.json`) is furnished with the library's models; see `executor.scenes.cousins`.

    Raises:
        SceneNotFound: When the package has no scene of that name; the message has the near ones.
        SceneError: When the file is missing or malformed.
    """
    return converted(name_or_path).scene


def converted(name_or_path: str | Path) -> Converted:
    """Returns a scene as `load_scene` does, with what differs in it from what its file says, in sentences."""
    path = Path(name_or_path)
    named = isinstance(name_or_path, Path) or path.suffix == ".json" or len(path.parts) > 1
    if not (named or path.is_file() or path.is_fifo()):
        return Converted(load(str(name_or_path)), ())
    return from_cousins(path) if holds_cousins(path) else Converted(Scene.from_json(path), ())
