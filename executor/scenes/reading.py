"""Scenes by name or by file, the way that people name them on a command line, in every form that is read."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from executor.scenes.cousins import Converted, from_cousins
from executor.scenes.furnishing.furnish import furnished, with_floor
from executor.scenes.library import file_of, holds_cousins, load
from oag import Scene, SceneError
from oag.model.errors import listed
from oag.model.scenefile import FULL_SCALE

Listener = Callable[[tuple[str, ...]], None]

_FLOOR_NAMES = frozenset({"floor", "ground"})


def load_scene(name_or_path: str | Path) -> Scene:
    """Returns a scene of the package by its name, or the scene of a JSON file.

    Anything that ends in `.json`, has a folder in it, or exists as a file is taken for a file. What the file leaves
    out comes from the library and from geometry (`executor.scenes.furnishing`). A file of Digital Cousins
    (`scene_0_info.json`) is furnished with the library's models; see `executor.scenes.cousins`.

    Raises:
        SceneNotFound: When the package has no scene of that name; the message has the near ones.
        SceneError: When the file is missing or malformed, or what it says makes no scene; all that is wrong is listed.
            Also when the argument is neither a name nor a path.
    """
    return converted(name_or_path).scene


def scene_for(
    query: str, name_or_path: str | Path, *, full_size: bool = False, listen: Listener = lambda notes: None
) -> Scene:
    """Returns the scene that a sentence is about: that of `load_scene`, with the floor where the sentence names it.

    Args:
        query: The sentence.
        name_or_path: As for `load_scene`.
        full_size: Whether the robot is of full size, whatever the scene has.
        listen: Receives what differs in the scene from what its file has, in sentences.

    Raises:
        SceneNotFound, SceneError: As for `load_scene`.
    """
    found = converted(name_or_path)
    listen(found.notes)
    scene = found.scene
    if full_size:
        scene = scene.with_robot(FULL_SCALE)
    return with_floor(scene) if _FLOOR_NAMES.intersection(re.findall(r"\w+", query.casefold())) else scene


def converted(name_or_path: str | Path) -> Converted:
    """Returns a scene as `load_scene` does, with what differs in it from what its file says, in sentences."""
    path = file_of(name_or_path)
    if path is None:
        return Converted(load(str(name_or_path)), ())
    if holds_cousins(path):
        return from_cousins(path)
    found = furnished(path)
    if found.scene is None:
        said = found.problems[0] if len(found.problems) == 1 else listed(found.problems)
        raise SceneError(said, source=path.name)
    return Converted(found.scene, found.warnings)
