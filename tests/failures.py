"""The oracle for named failures: complete states after a step that goes wrong; shares no code with the package."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from tests.bruteforce import Kinds, Part, World, act

MOTIONS = (1, 2, 6, *range(7, 17), 17, 18, 20, 21)


def failures(world: World, part: Part, action: int, kinds: Kinds) -> Iterator[tuple[str, str | None, World]]:
    """Every state that a step can end in when it goes wrong, with the failure's name and what it is about."""
    held = world.hand if world.hand in kinds.items else None
    done = act(world, part, action, kinds)
    if action in (17, 18):
        yield "miss", None, replace(done, base=None)
    if action in (1, 2):
        yield "miss", None, replace(world, arm=("free", ""))
    if action == 3:
        yield "miss", None, world
    if action in (4, 19):
        for true in (world.true | {("open", part.target)}, world.true - {("open", part.target)}):
            yield "slip", part.target, replace(world, true=true, hand=None)
    if action == 5 and held is not None and part.place is not None:
        yield "drop", held, replace(world, hand=None, true=fallen(world, held))
    if action in MOTIONS:
        if held is not None:
            yield "slip", held, replace(done, true=world.true, hand=None)
            yield "drop", held, replace(done, true=fallen(world, held), hand=None)
        for fixture in kinds.fixtures:
            yield "collide", fixture, replace(done, true=done.true - {("open", fixture)})


def fallen(world: World, item: str) -> frozenset[tuple[str, ...]]:
    """What is true once an item lies on the floor."""
    return frozenset(fact for fact in world.true if fact[0] == "open" or fact[1] != item)
