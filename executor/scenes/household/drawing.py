"""The 102 pairs of a seed: each room arranged, its wish planned offline, its sizes adjusted, and settled in physics."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import llm
from executor.scenes.household.arrange import arrange
from executor.scenes.household.layouts import Layout, Wish, layouts
from executor.scenes.pair import ScenePair
from executor.scenes.rooms import NoRoom
from executor.scenes.settle import Unsettled, settle
from llm import QueryError
from oag import Scene, Task, Verdict, compose

VARIATIONS = 3
COUNT = 34 * VARIATIONS
MOST_ATTEMPTS = 25
"""How often sizes and places are drawn anew where things do not fit or do not stay where they are put."""

_FLOWS = {"open": "ARTICULATE_OPEN", "close": "ARTICULATE_CLOSE", "pick": "GRASP"}


class NotArranged(RuntimeError):
    """No draw of a room came out as its layout says; the message has the last reason."""

    def __init__(self, layout: Layout, seed: int, reasons: list[str]) -> None:
        super().__init__(f"{layout.name}, seed {seed}: {len(reasons)} draws failed, the last one because {reasons[-1]}")
        self.reasons = tuple(reasons)


class Misplanned(ValueError):
    """The planner understood a query otherwise than its layout means it."""


@dataclass(frozen=True, slots=True)
class _Drawn:
    """A pair with the reasons why earlier draws were not taken."""

    pair: ScenePair
    reasons: tuple[str, ...]


def pairs(seed: int) -> tuple[ScenePair, ...]:
    """Returns the 102 pairs of a seed in their fixed order: each layout's three variations, kitchens first.

    Args:
        seed: Any integer from 0.

    Raises:
        NotArranged: A room could not be arranged.
    """
    return tuple(pair(seed, index) for index in range(COUNT))


def pair(seed: int, index: int) -> ScenePair:
    """Returns one pair of a seed; equal seeds and indices give equal ones.

    Args:
        seed: Any integer from 0.
        index: 0 to 101.

    Raises:
        IndexError: There is no pair of that index.
        NotArranged: The room could not be arranged.
    """
    return drawn(seed, index).pair


def drawn(seed: int, index: int) -> _Drawn:
    """Returns a pair with why earlier draws of its sizes and places were rejected; raises as `pair` does."""
    if not 0 <= index < COUNT:
        raise IndexError(f"there are {COUNT} pairs, 0 to {COUNT - 1}; got {index}")
    layout, variation = layouts()[index // VARIATIONS], index % VARIATIONS
    wish = layout.wishes[variation]
    reasons: list[str] = []
    for attempt in range(MOST_ATTEMPTS):
        try:
            scene = arrange(layout, variation, seed, attempt)
            plan = _planned(scene, wish)
            settled = settle(scene.with_scales(plan.scales))
            task = _planned(settled, wish)
        except (NoRoom, Unsettled, Misplanned) as problem:
            reasons.append(str(problem))
            continue
        identity = f"{wish.family}-{seed}-{layout.name}-{'abc'[variation]}"
        return _Drawn(ScenePair(identity, wish.family, wish.query, settled, task), tuple(reasons))
    raise NotArranged(layout, seed, reasons)


def mismatches(task: Task, wish: Wish) -> Iterator[str]:
    """Yields how a planned task differs from what a wish means; nothing where it is what is meant."""
    if len(task.subtasks) != 1:
        yield f"it has {len(task.subtasks)} subtasks"
    subtask = task.subtasks[-1]
    if subtask.target != wish.target:
        yield f"it is about {subtask.target}, not {wish.target}"
    if subtask.flow is None or _FLOWS[wish.deed] not in {action.primitive.name for action in subtask.flow}:
        yield f"it does not {wish.deed} anything"
    verdict = compose(task).verify().verdict
    if verdict is not Verdict.PROVED:
        yield f"it is {verdict.name}"


def _planned(scene: Scene, wish: Wish) -> Task:
    try:
        task = llm.propose(wish.query, scene).task
    except QueryError as error:
        raise Misplanned(f"{wish.query!r}: {error}") from None
    problems = list(mismatches(task, wish))
    if problems:
        raise Misplanned(f"{wish.query!r}: {'; '.join(problems)}")
    return task
