"""Named scenes of the package, and scene files in this project's own form."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib import import_module, resources
from os import PathLike
from pathlib import Path
from typing import cast

import bddl
from bddl import near_names
from bddl.errors import Scene2DemoError
from bddl.files import read_bounded_text
from oag import Scene, SceneError
from oag.model.codec import load as load_json
from oag.model.codec import shown
from oag.model.domain import BUILT_IN, Domain

_DATA = resources.files(__package__) / "data"
# Module and function that draw a scene from its name; the function returns None for an unknown form. Loaded lazily:
# drawing needs physics and the planner, reading a file needs neither.
_DRAWN = ("generators.families", "draw_named")


class SceneNotFound(Scene2DemoError):
    """The package has no scene of this name."""

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        self.name = name
        self.near = tuple(near_names(name, known))
        hint = f"did you mean {' or '.join(self.near)}? " if self.near else ""
        super().__init__(f"there is no scene {name!r}; {hint}`scene2demo scenes` lists all, such as {', '.join(known)}")


def names() -> tuple[str, ...]:
    """Return the names of the package's fixed scenes, sorted; `executor.scenes.generators.families` draws others."""
    return tuple(sorted(entry.name[:-5] for entry in _DATA.iterdir() if entry.name.endswith(".json")))


def load(name: str) -> Scene:
    """Return a scene of the package as written (objects at their original size, nothing varied).

    A name such as kitchen02-b or kitchen02-13000-b is a household's room, one such as t1-12000 a drawn kitchen.

    Raises:
        SceneNotFound: No scene has that name; the message suggests near ones.
        NotDrawn: The layouts of a drawn scene do not hold.
    """
    known = names()
    if name in known:
        return Scene.from_json(json.loads((_DATA / f"{name}.json").read_text(encoding="utf-8")))
    module, function = _DRAWN
    draw = cast("Callable[[str], Scene | None]", getattr(import_module(f"{__package__}.{module}"), function))
    scene = draw(name)
    if scene is None:
        raise SceneNotFound(name, known)
    return scene


def load_own(name_or_path: str | Path, domain: Domain = BUILT_IN) -> Scene:
    """Return a scene of the package by its name, or the scene of a JSON file in this project's own form, in a domain.

    Raises:
        SceneNotFound: The package has no scene of that name; the message suggests near ones.
        SceneError: The file is missing, malformed, in another form, or incomplete; `scene2demo scenes` completes it
            from the library and geometry.
    """
    path = file_of(name_or_path)
    option = "" if domain.built_in else " --domain DOMAIN.toml"
    if path is None:
        return described_in(load(str(name_or_path)), domain)
    if holds_cousins(path):
        problem = "has the form of Digital Cousins, and what is compared has this project's own"
        hint = f"scene2demo scenes {path}{option} --out SCENE.json writes it so"
        raise SceneError(problem, source=path.name, hint=hint)
    document = load_json(path, SceneError)
    if isinstance(document.data, dict) and document.data.get("closed") is None:
        problem = "has no 'closed': what geometry says of it is not in it"
        raise document.fail((), problem, f"scene2demo scenes {path}{option} --out SCENE.json writes it whole")
    return Scene.from_json(path, domain)


def load_in_words(name_or_path: str | Path, domain: Domain = BUILT_IN) -> Scene | None:
    """Return the scene of a file of categories and facts alone, as `oag.scene` writes it; None for any other.

    Nothing of it can be built, and plans are proved for it as it is.
    """
    path = file_of(name_or_path)
    if path is None or not path.is_file():
        return None
    data = load_json(path, SceneError).data
    objects = data.get("objects") if isinstance(data, dict) and "closed" in data else None
    in_words = isinstance(objects, dict) and all(
        isinstance(one, dict) and [*one] == ["category"] for one in objects.values()
    )
    return Scene.from_json(path, domain) if in_words and objects else None


def described_in(scene: Scene, domain: Domain) -> Scene:
    """Return a scene in another domain, with what its facts say in the predicates that this domain has, too."""
    facts = [fact for fact in scene.facts if all(has_predicate(domain, atom.predicate) for atom in bddl.atoms(fact))]
    closed = frozenset(predicate for predicate in scene.closed if has_predicate(domain, predicate))
    return replace(scene, facts=tuple(facts), closed=closed, domain=domain)


def has_predicate(domain: Domain, name: str) -> bool:
    """Decide whether a domain has a predicate that geometry decides, with as many arguments."""
    own, usual = domain.predicates.get(name), Domain.fallen(appliances=True).predicates[name]
    return own is not None and len(own.parameters) == len(usual.parameters)


def file_of(name_or_path: str | Path) -> Path | None:
    """Return the file of an argument that ends in `.json`, has a folder in it, or exists; None for a name.

    Raises:
        SceneError: It is neither a name nor a path.
    """
    if not isinstance(name_or_path, str | PathLike):
        problem = f"expected the name of a scene or the path of its file, got {shown(name_or_path)}"
        raise SceneError(problem, source="(argument)", hint="oag.Scene.from_json reads a mapping")
    path = Path(name_or_path)
    named = not isinstance(name_or_path, str) or path.suffix == ".json" or len(path.parts) > 1
    return path if named or path.is_file() or path.is_fifo() else None


def holds_cousins(path: Path) -> bool:
    """Return whether a file is a scene reconstructed by Digital Cousins; False for a file that is not JSON."""
    try:
        data = json.loads(read_bounded_text(path))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(data, Mapping) and ("cam_pose" in data or is_collection(data))


def is_collection(data: Mapping[str, object]) -> bool:
    """Return whether data is `step_3_output_info.json` of Digital Cousins, which has all scenes of a photograph."""
    return bool(data) and all(isinstance(value, Mapping) and "cam_pose" in value for value in data.values())
