"""The scenes that come with the package, by name."""

from __future__ import annotations

import json
from importlib import resources

from bddl import near_names
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
