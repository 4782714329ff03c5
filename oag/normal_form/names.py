"""Names in a plan, resolved to the ids of the scene's objects where they can mean only one of them.

Source: docs/canonical.md, Names.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable
from dataclasses import replace
from functools import cache
from typing import TypeVar

from oag.model.facts import GRIPPER
from oag.model.scene import ROBOT, Scene, SceneObject
from oag.task.rebuilding import renamed
from oag.task.task import Task

# Words for the same thing. Narrower than the groups that near names come from: a cup is like a glass, but it is none.
_SAME = tuple(
    frozenset(group.split())
    for group in (
        "refrigerator fridge icebox",
        "cupboard cabinet",
        "countertop counter worktop",
        "couch sofa settee",
        "bookcase bookshelf",
        "nightstand bedsidetable",
        "trashcan garbagecan dustbin",
        "wardrobe closet",
    )
)
_NUMBER = re.compile(r"[\s_.-]*(\d+)\Z")
_ARTICLE = re.compile(r"\A(?:the|a|an)[\s_-]+")
_SEPARATORS = re.compile(r"[\s_.-]+")

Resolve = Callable[[str], str]
_Key = TypeVar("_Key", bound=Hashable)


def resolver(scene: Scene) -> Resolve:
    """Returns the function that maps a name to the id of the one object of the scene that it can mean.

    An id is itself. Letter case, blanks, hyphens and articles do not matter. A noun without a number means the object
    of that noun, or of a word for the same thing, when the scene has exactly one; with a number, the object of that
    number. Every other name is returned as it is, so that nothing is guessed.
    """
    ids = (*scene.objects, GRIPPER, ROBOT)
    exact = frozenset(ids)
    spelled = _unique((_squeeze(name), name) for name in ids)
    nouns = _unique((noun, key) for key, thing in scene.objects.items() for noun in _nouns(key, thing))
    numbered = _unique(
        ((noun, _split(key)[1]), key) for key, thing in scene.objects.items() for noun in _nouns(key, thing)
    )

    @cache
    def resolve(name: str) -> str:
        if name in exact:
            return name
        bare = _ARTICLE.sub("", name.strip().casefold())
        noun, number = _split(bare)
        found = spelled.get(_squeeze(bare)) or (numbered.get((noun, number)) if number else nouns.get(noun))
        return name if found is None else found

    return resolve


def _unique(pairs: Iterable[tuple[_Key, str]]) -> dict[_Key, str]:
    """Returns the keys that stand for exactly one id, with that id."""
    meant: dict[_Key, set[str]] = {}
    for key, name in pairs:
        meant.setdefault(key, set()).add(name)
    return {key: names.pop() for key, names in meant.items() if len(names) == 1}


def _squeeze(name: str) -> str:
    """Returns a name without what different hands write differently."""
    return _SEPARATORS.sub("", name.casefold())


def _split(name: str) -> tuple[str, str]:
    """Returns the noun of a name, squeezed, and its number as text, empty when it has none."""
    match = _NUMBER.search(name)
    return (_squeeze(name), "") if match is None else (_squeeze(name[: match.start()]), match[1])


def _nouns(key: str, thing: SceneObject) -> frozenset[str]:
    """Returns the nouns that an object goes by: those of its id and of its category, and words for the same thing."""
    own = {_split(key)[0], _squeeze(thing.category.split(".", 1)[0])}
    return frozenset(own.union(*(group for group in _SAME if group & own)))


def with_scene_names(task: Task, resolve: Resolve) -> Task:
    """Returns the task with every role, formula and scale named by the scene's ids."""

    def role(name: str | None) -> str | None:
        return None if name is None else resolve(name)

    subtasks = tuple(
        replace(
            subtask,
            target=resolve(subtask.target),
            support_init=role(subtask.support_init),
            support_goal=role(subtask.support_goal),
            init=renamed(subtask.init, resolve),
            goal=renamed(subtask.goal, resolve),
        )
        for subtask in task.subtasks
    )
    scales = {resolve(name): factor for name, factor in task.scales.items()}
    return replace(task, goal=renamed(task.goal, resolve), subtasks=subtasks, scales=scales)
