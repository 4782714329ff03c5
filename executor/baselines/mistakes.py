"""Right decompositions with one thing wrong: what is executed when nobody checks.

It is no language model, and imitates none. The first four kinds are those of the noise model that the canonical form is
measured by (`benchmarks/noise.py`); the last two are mistakes of order and of a flow. The task goal stays as it was: it
comes from the sentence, apart from the decomposition.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterator
from dataclasses import replace

from bddl import Not, format, parse_formula
from oag import Scene, SimpleTask, Task

Subtasks = tuple[SimpleTask, ...]
Spoil = Callable[[Subtasks, Scene, random.Random], Subtasks | None]
"""Returns subtasks with something wrong, or None where there is no place for this kind of mistake."""


def with_mistake(task: Task, scene: Scene, seed: str) -> tuple[str, Task]:
    """Returns the kind of a mistake and the task with it.

    Args:
        task: A right decomposition, with flows.
        scene: Has the objects that may be taken for one another.
        seed: Decides everything; every kind that has a place in the task is as likely as any other.
    """
    rng = random.Random(seed)
    for kind in rng.sample(sorted(MISTAKES), len(MISTAKES)):
        subtasks = MISTAKES[kind](task.subtasks, scene, rng)
        if subtasks is not None and subtasks != task.subtasks:
            return kind, replace(task, subtasks=subtasks)
    raise ValueError(f"{task.name} has no place for any mistake")


def _dropped_subtask(subtasks: Subtasks, scene: Scene, rng: random.Random) -> Subtasks | None:
    if len(subtasks) < 2:
        return None
    at = rng.randrange(len(subtasks))
    return subtasks[:at] + subtasks[at + 1 :]


def _wrong_object(subtasks: Subtasks, scene: Scene, rng: random.Random) -> Subtasks | None:
    at = rng.randrange(len(subtasks))
    roles = sorted({role for role in subtasks[at].roles if role is not None})
    others = [name for name in scene.objects if name not in roles]
    if not others:
        return None
    wrong, other = rng.choice(roles), rng.choice(others)
    return _with(subtasks, at, _renamed(subtasks[at], wrong, other))


def _flipped_goal(subtasks: Subtasks, scene: Scene, rng: random.Random) -> Subtasks | None:
    at = rng.randrange(len(subtasks))
    goal = subtasks[at].goal
    return _with(subtasks, at, replace(subtasks[at], goal=goal.body if isinstance(goal, Not) else Not(goal)))


def _swapped_roles(subtasks: Subtasks, scene: Scene, rng: random.Random) -> Subtasks | None:
    found = list(_swaps(subtasks))
    return _with(subtasks, *rng.choice(found)) if found else None


def _swaps(subtasks: Subtasks) -> Iterator[tuple[int, SimpleTask]]:
    for at, subtask in enumerate(subtasks):
        for role in ("support_init", "support_goal"):
            support = getattr(subtask, role)
            if support is not None and support != subtask.target:
                yield at, replace(subtask, **{"target": support, role: subtask.target})
        if subtask.support_init != subtask.support_goal:
            yield at, replace(subtask, support_init=subtask.support_goal, support_goal=subtask.support_init)


def _wrong_order(subtasks: Subtasks, scene: Scene, rng: random.Random) -> Subtasks | None:
    if len(subtasks) < 2:
        return None
    at = rng.randrange(len(subtasks) - 1)
    return (*subtasks[:at], subtasks[at + 1], subtasks[at], *subtasks[at + 2 :])


def _dropped_step(subtasks: Subtasks, scene: Scene, rng: random.Random) -> Subtasks | None:
    at = rng.randrange(len(subtasks))
    flow = subtasks[at].flow or ()
    if len(flow) < 2:
        return None
    step = rng.randrange(len(flow))
    return _with(subtasks, at, replace(subtasks[at], flow=flow[:step] + flow[step + 1 :]))


MISTAKES: dict[str, Spoil] = {
    "dropped subtask": _dropped_subtask,
    "wrong object": _wrong_object,
    "flipped goal": _flipped_goal,
    "swapped roles": _swapped_roles,
    "wrong order": _wrong_order,
    "dropped step": _dropped_step,
}
"""Kind -> what makes it."""


def _with(subtasks: Subtasks, at: int, changed: SimpleTask) -> Subtasks:
    return (*subtasks[:at], changed, *subtasks[at + 1 :])


def _renamed(subtask: SimpleTask, wrong: str, other: str) -> SimpleTask:
    """Returns a subtask that speaks of another object, in its roles and in its conditions."""

    def role(name: str | None) -> str | None:
        return other if name == wrong else name

    def formula(text: str) -> str:
        return re.sub(rf"(?<![\w-]){re.escape(wrong)}(?![\w-])", other, text)

    return replace(
        subtask,
        target=other if subtask.target == wrong else subtask.target,
        support_init=role(subtask.support_init),
        support_goal=role(subtask.support_goal),
        init=parse_formula(formula(format(subtask.init))),
        goal=parse_formula(formula(format(subtask.goal))),
    )
