"""Scenes by name or by file, the way that people name them on a command line; some come with the package."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib import import_module, resources
from pathlib import Path
from typing import cast

from bddl import near_names
from executor.scenes.cousins import Converted, from_cousins, holds_cousins
from executor.scenes.furnish import furnished
from oag import Scene, SceneError
from oag.model.errors import listed

_DATA = resources.files(__package__) / "data"
# What draws a scene by its name, None for what is no such name. It is loaded when a name is not that of a fixed scene:
# drawing takes physics and the planner, reading a file takes neither.
_DRAWN = ("drawn", "named")


class SceneNotFound(LookupError):
    """No scene of this name comes with the package."""

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        self.name = name
        self.near = tuple(near_names(name, known))
        hint = f"did you mean {' or '.join(self.near)}? " if self.near else ""
        super().__init__(f"there is no scene {name!r}; {hint}`scene2demo scenes` lists all, such as {', '.join(known)}")


def names() -> tuple[str, ...]:
    """Returns the names of the fixed scenes that come with the package, sorted; `drawn_names` are the others."""
    return tuple(sorted(entry.name[:-5] for entry in _DATA.iterdir() if entry.name.endswith(".json")))


def load(name: str) -> Scene:
    """Returns a scene of the package, as it is written (objects at their original size, nothing varied).

    A name such as kitchen02-b or kitchen02-13000-b is a household's room, one such as t1-12000 a drawn kitchen.

    Raises:
        SceneNotFound: When there is none of that name; the message has the near ones.
        NotDrawn: The layouts of a drawn scene do not hold.
    """
    known = names()
    if name in known:
        return Scene.from_json(json.loads((_DATA / f"{name}.json").read_text(encoding="utf-8")))
    module, function = _DRAWN
    draw = cast("Callable[[str], Scene | None]", getattr(import_module(f"{__package__}.{module}"), function))
    scene = draw(name)
    if scene is not None:
        return scene
    raise SceneNotFound(name, known)


def load_scene(name_or_path: str | Path) -> Scene:
    """Returns a scene of the package by its name, or the scene of a JSON file.

    Anything that ends in `.json`, has a folder in it, or exists as a file is taken for a file. What the file leaves
    out comes from the library and from geometry (`executor.scenes.furnish`). A file of Digital Cousins
    (`scene_0_info.json`) is furnished with the library's models; see `executor.scenes.cousins`.

    Raises:
        SceneNotFound: When the package has no scene of that name; the message has the near ones.
        SceneError: When the file is missing or malformed, or what it says does not make a scene.
    """
    return converted(name_or_path).scene


def converted(name_or_path: str | Path) -> Converted:
    """Returns a scene as `load_scene` does, with what differs in it from what its file says, in sentences."""
    if not is_file(name_or_path):
        return Converted(load(str(name_or_path)), ())
    path = Path(name_or_path)
    if holds_cousins(path):
        return from_cousins(path)
    found = furnished(path)
    if found.scene is None:
        said = found.problems[0] if len(found.problems) == 1 else listed(found.problems)
        raise SceneError(said, source=path.name)
    return Converted(found.scene, ())


def is_file(name_or_path: str | Path) -> bool:
    """Decides whether a scene is named by its file."""
    path = Path(name_or_path)
    named = isinstance(name_or_path, Path) or path.suffix == ".json" or len(path.parts) > 1
    return named or path.is_file() or path.is_fifo()
