"""Single mistakes in right plans, with what an independent simulation says of each.

Two things are asked of the first error, and a simulation of the complete start state, which knows nothing of the
package, answers both. *Stop*: is it where the simulation of the wrong plan stops? *Root*: does it point at the mistake
itself? It does when it stands at a changed place, names a step of one as the writer of what is wrong, or lacks what the
changed part makes true in the simulation of the right plan, so that the part is the missing producer.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import bddl
import oag
from oag.model.symbols import Kind
from tests.bruteforce import Kinds, Literal, Part, World, act, read_action, run, split

WIDEST_GRASP_M = 0.053
# kind, subtask and step, as the simulation names places; a step of -1 is the condition as a whole.
Place = tuple[str, int, int]


@dataclass(frozen=True)
class Mutant:
    """One wrong plan; `subtask` and `step` are what was changed, None for what has no such part.

    `other` is the second of two swapped subtasks. A deleted subtask has the number that it had.
    """

    kind: str
    data: dict[str, Any]
    subtask: int | None
    step: int | None = None
    other: int | None = None

    @property
    def parts(self) -> tuple[int, ...]:
        """The changed subtasks, as the right plan numbers them."""
        return tuple(index for index in (self.subtask, self.other) if index is not None)


# What nothing goes into, of the things in the plans.
SOLID = ("table", "apple", "pen", "plate", "desk", "book")


@dataclass(frozen=True)
class World0:
    """What the simulation needs of a scene in which everything is known."""

    true: frozenset[tuple[str, ...]]
    kinds: Kinds
    surfaces: frozenset[str]
    widths_m: dict[str, float]
    solid: frozenset[str]

    @classmethod
    def of(cls, scene: oag.Scene) -> World0:
        literals = [literal for fact in scene.facts for literal in bddl.literals(fact) or ()]
        kinds = {key: thing.kind for key, thing in scene.objects.items()}
        return cls(
            frozenset((x.atom.predicate, *x.atom.args) for x in literals if x.value),
            Kinds(
                frozenset(key for key, kind in kinds.items() if kind is Kind.ITEM),
                frozenset(key for key, kind in kinds.items() if kind is Kind.ARTICULATED),
            ),
            frozenset(key for key, kind in kinds.items() if kind is Kind.SUPPORT),
            {
                # What has a wall between the fingers is as wide as that.
                key: 0.004 if thing.category.endswith(("bowl", "cup", "mug")) else min(thing.extent_m[:2])
                for key, thing in scene.objects.items()
            },
            frozenset(key for key, thing in scene.objects.items() if thing.category.endswith(SOLID)),
        )


def mutants(data: dict[str, Any], objects: tuple[str, ...]) -> Iterator[Mutant]:
    """Yield every single mistake of a plan: steps and subtasks deleted, subtasks swapped, roles swapped, wrong objects
    in roles and conditions, and flipped literals of initial conditions, goals and the task goal."""
    subtasks = data["sub_tasks"]
    for index, subtask in enumerate(subtasks):
        for step in range(len(subtask["flow"])):
            changed = copy.deepcopy(data)
            del changed["sub_tasks"][index]["flow"][step]
            yield Mutant("step deleted", changed, index, step)
    for index in range(len(subtasks)):
        changed = copy.deepcopy(data)
        del changed["sub_tasks"][index]
        yield Mutant("subtask deleted", changed, index)
    for first in range(len(subtasks)):
        for second in range(first + 1, len(subtasks)):
            changed = copy.deepcopy(data)
            order = changed["sub_tasks"]
            order[first], order[second] = order[second], order[first]
            yield Mutant("subtasks swapped", changed, first, other=second)
    for index, subtask in enumerate(subtasks):
        yield from _role_swaps(data, index, subtask)
        yield from _wrong_objects(data, index, subtask, objects)
        for key in ("init", "goal"):
            for text in _flips(subtask[key]):
                changed = copy.deepcopy(data)
                changed["sub_tasks"][index][key] = text
                yield Mutant(f"{key} flipped", changed, index)
    for text in _flips(data["goal"]):
        changed = copy.deepcopy(data)
        changed["goal"] = text
        yield Mutant("task goal flipped", changed, None)


def _role_swaps(data: dict[str, Any], index: int, subtask: dict[str, Any]) -> Iterator[Mutant]:
    for one, other in (("target", "support_init"), ("target", "support_goal"), ("support_init", "support_goal")):
        if subtask[one] != subtask[other] and ((subtask[one] and subtask[other]) or one != "target"):
            changed = copy.deepcopy(data)
            part = changed["sub_tasks"][index]
            part[one], part[other] = part[other], part[one]
            yield Mutant("roles swapped", changed, index)


def _wrong_objects(
    data: dict[str, Any], index: int, subtask: dict[str, Any], objects: tuple[str, ...]
) -> Iterator[Mutant]:
    for role in ("target", "support_goal"):
        for name in objects:
            if subtask[role] and subtask[role] != name:
                changed = copy.deepcopy(data)
                changed["sub_tasks"][index][role] = name
                yield Mutant("wrong object in a role", changed, index)
    for key in ("init", "goal"):
        literals = _literals(subtask[key])
        for position, (fact, value) in enumerate(literals):
            for argument in range(1, len(fact)):
                for name in objects:
                    if fact[argument] not in (name, "gripper"):
                        other = (*fact[:argument], name, *fact[argument + 1 :])
                        changed = copy.deepcopy(data)
                        parts = [*literals[:position], (other, value), *literals[position + 1 :]]
                        changed["sub_tasks"][index][key] = _text(parts)
                        yield Mutant(f"wrong object in {key}", changed, index)


def _flips(text: str) -> Iterator[str]:
    literals = _literals(text)
    for position, (fact, value) in enumerate(literals):
        yield _text([*literals[:position], (fact, not value), *literals[position + 1 :]])


def _literals(text: str) -> list[Literal]:
    found = bddl.literals(bddl.parse_formula(text)) or ()
    return [((literal.atom.predicate, *literal.atom.args), literal.value) for literal in found]


def _text(literals: list[Literal]) -> str:
    parts = [f"({' '.join(fact)})" if value else f"(not ({' '.join(fact)}))" for fact, value in literals]
    return parts[0] if len(parts) == 1 else f"(and {' '.join(parts)})"


def parts_of(data: dict[str, Any]) -> tuple[Part, ...]:
    """The plan in the simulation's form."""
    return tuple(
        Part(
            subtask["target"],
            subtask["support_goal"],
            tuple(_literals(subtask["init"])),
            tuple(_literals(subtask["goal"])),
            tuple(read_action(item) for item in subtask["flow"]),
        )
        for subtask in data["sub_tasks"]
    )


def ill_formed(data: dict[str, Any], world: World0) -> int | bool | None:
    """The first subtask that cannot be meant as written, None for the task goal, False when all is well formed."""
    for index, part in enumerate(parts_of(data)):
        supports = (data["sub_tasks"][index]["support_init"], part.support)
        if part.target in supports or (part.place is not None and part.place[1] != part.support):
            return index
        if _contradictory(part.init, world) or _contradictory(part.goal, world):
            return index
        primitives = {split(action)[0] for action in part.flow}
        if 18 in primitives and part.support is None:
            return index
        if part.target not in world.kinds.fixtures and {4, 19} & primitives:
            return index
        if 3 in primitives:
            scale = data.get("scales", {}).get(part.target, 1.0)
            wide = part.target in world.kinds.items and world.widths_m[part.target] * scale > WIDEST_GRASP_M
            if part.target in world.surfaces or wide:
                return index
    return None if _contradictory(tuple(_literals(data["goal"])), world) else False


def _contradictory(literals: tuple[Literal, ...], world: World0) -> bool:
    """Whether a condition holds in no state, or asks that what has no joint be open, or something in what is solid."""
    true = {fact for fact, value in literals if value}
    false = {fact for fact, value in literals if not value}
    if true & false or any(fact[0] == "open" and fact[1] not in world.kinds.fixtures for fact in true):
        return True
    if any(fact[0] == "inside" and fact[2] in world.solid for fact in true):
        return True
    return any(len(f) == 3 and (f[1] == f[2] or (f[0], f[2], f[1]) in true) for f in true)


def simulated(data: dict[str, Any], world: World0) -> Place | None:
    """The first place where a well-formed plan stops, None when it reaches its goal."""
    parts = parts_of(data)
    base = parts[0].target if parts else None
    return run(World(world.true, base=base, arm=("home", "")), parts, tuple(_literals(data["goal"])), world.kinds)


def blamed(report: oag.Report) -> tuple[int | None, int | None]:
    """Subtask and step that the first error names."""
    error = report.errors[0]
    return error.subtask, error.step


def is_stop(mutant: Mutant, report: oag.Report, world: World0) -> bool:
    """Whether the first error is where the simulation stops, or where a plan cannot be meant as written."""
    formed = ill_formed(mutant.data, world)
    subtask, step = blamed(report)
    if formed is not False:
        return subtask == formed
    stop = simulated(mutant.data, world)
    if stop is None:
        return False
    kind, index, position = stop
    return (subtask, step) == (None if kind == "task-goal" else index, None if position < 0 else position)


def is_root(mutant: Mutant, report: oag.Report, right: dict[str, Any], world: World0) -> bool:
    """Whether the first error points at the mistake itself: at its place, at its step, or at what is missing."""
    error = report.errors[0]
    if mutant.subtask is None:
        return error.subtask is None
    if mutant.kind != "subtask deleted":
        if error.subtask in mutant.parts:
            # What comes before a deleted step in its subtask is not changed.
            return mutant.step is None or error.step is None or error.step >= mutant.step
        if error.since is not None and error.since.partition(" ")[0] in {f"T{index + 1}" for index in mutant.parts}:
            return True
    return error.literal in made_by(right, mutant.parts, mutant.step, world)


def made_by(data: dict[str, Any], parts: tuple[int, ...], step: int | None, world: World0) -> set[str]:
    """What some subtasks of a right plan, or one step, make true in the simulation, as errors say it."""
    made: set[str] = set()
    plan = parts_of(data)
    state = World(world.true, base=plan[0].target if plan else None, arm=("home", ""))
    for index, part in enumerate(plan):
        for position, action in enumerate(part.flow):
            after = act(state, part, action, world.kinds)
            if index in parts and step in (None, position):
                made |= _said(after, state)
            state = after
    return made


def _said(after: World, before: World) -> set[str]:
    """What is so in a state and was not in another one."""
    said = {_fact_said(fact) for fact in after.true - before.true}
    said |= {f"not {_fact_said(fact)}" for fact in before.true - after.true}
    if after.hand != before.hand:
        said.add("handempty" if after.hand is None else f"inside({after.hand}, gripper)")
        said.add(f"gripping({after.hand})" if after.hand is not None else f"not inside({before.hand}, gripper)")
    if after.base != before.base:
        said.add(f"near({after.base})")
    if after.arm != before.arm and after.arm is not None:
        said.add(f"eef({' '.join(after.arm).strip()})")
    return said


def _fact_said(fact: tuple[str, ...]) -> str:
    return f"{fact[0]}({', '.join(fact[1:])})"


def same_plan(repaired: oag.Task, original: oag.Task, *, flows: bool) -> bool:
    """Whether two plans are the same but for names, numbers, and steps that are geometry alone."""
    return _essence(repaired, flows) == _essence(original, flows)


def _essence(task: oag.Task, flows: bool) -> list[object]:
    essence: list[object] = [set(bddl.conjuncts(task.goal))]
    for part in task.subtasks:
        steps = [a.primitive for a in part.flow or () if a.primitive < 6 or a.primitive in (7, 17, 18, 19)]
        essence.append((part.target, set(bddl.conjuncts(part.init)), set(bddl.conjuncts(part.goal))))
        essence.append(steps if flows else None)
    return essence
