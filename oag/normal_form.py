"""Canonical form of a task: equal for all descriptions of one decomposition.

    oag.canonical(task) == oag.canonical(reworded)

Names are resolved to the scene's ids. A proved plan is cut into movements where the hand is at rest. Independent parts
are ordered by the Foata normal form of the trace that the plan is a word of. Its letters are the parts between places
where the hand is empty and the next step navigates. There the robot's pose does not matter, so two parts without common
facts can be exchanged.

Source: docs/semantics.md, Canonical form; the paper's repeated decomposition study, which this makes a statement about
formulas.
Cartier and Foata, Problemes combinatoires de commutation et rearrangements (1969).
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import chain, groupby, pairwise
from typing import TypeVar

import bddl
from oag.certificate.recheck import digest
from oag.flows import complete
from oag.model.actions import Action, ActionFlow
from oag.model.robots import PAPER_ROBOT
from oag.model.scene import ROBOT, Scene, SceneObject
from oag.model.symbols import (
    ANY,
    ARTICULATIONS,
    EEF,
    EMPTY,
    GRIPPER,
    HAND,
    MAX_ANGLE_DEG,
    MAX_DISTANCE_M,
    NEAR,
    Fact,
    ParameterKind,
    Primitive,
    Value,
    generalisations,
    holding,
    parameter_kind,
)
from oag.primitives.cargo import RESTING
from oag.primitives.state import START
from oag.primitives.table import NAVIGATION
from oag.progression import Step, Trace
from oag.rewriting import normalize, normalize_goal, rename_objects, sorted_conjunction
from oag.task_definition import SimpleTask, Task, chosen_scene, default_goal
from oag.verify.verify import follow
from oag.wellformed import check

# Synonyms. Narrower than the groups of near names: a cup is like a glass, but is no glass.
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
    """Return the function that maps a name to the id of the one object of the scene that it can mean.

    An id is itself. Letter case, blanks, hyphens and articles do not matter. A noun without a number means the only
    object of that noun, or of a synonym; with a number, the object of that number. Every other name is returned
    unchanged, so that nothing is guessed.
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
    """Return the keys that stand for exactly one id, with that id."""
    meant: dict[_Key, set[str]] = {}
    for key, name in pairs:
        meant.setdefault(key, set()).add(name)
    return {key: names.pop() for key, names in meant.items() if len(names) == 1}


def _squeeze(name: str) -> str:
    return _SEPARATORS.sub("", name.casefold())


def _split(name: str) -> tuple[str, str]:
    """Return the noun of a name, squeezed, and its number as text, empty when it has none."""
    match = _NUMBER.search(name)
    return (_squeeze(name), "") if match is None else (_squeeze(name[: match.start()]), match[1])


def _nouns(key: str, thing: SceneObject) -> frozenset[str]:
    own = {_split(key)[0], _squeeze(thing.category.split(".", 1)[0])}
    return frozenset(own.union(*(group for group in _SAME if group & own)))


def with_scene_names(task: Task, resolve: Resolve) -> Task:
    """Return the task with every role, formula and scale named by the scene's ids."""

    def role(name: str | None) -> str | None:
        return None if name is None else resolve(name)

    subtasks = tuple(
        replace(
            subtask,
            target=resolve(subtask.target),
            support_init=role(subtask.support_init),
            support_goal=role(subtask.support_goal),
            init=rename_objects(subtask.init, resolve),
            goal=rename_objects(subtask.goal, resolve),
            where=None
            if (where := subtask.where) is None
            else replace(where, other=where.other and resolve(where.other)),
        )
        for subtask in task.subtasks
    )
    scales = {resolve(name): factor for name, factor in task.scales.items()}
    return replace(task, goal=rename_objects(task.goal, resolve), subtasks=subtasks, scales=scales)


_LARGEST = {ParameterKind.DISTANCE_M: MAX_DISTANCE_M, ParameterKind.ANGLE_DEG: MAX_ANGLE_DEG}
# Sums of decimal numbers are rounded to a nanometre, so that 0.1 and 0.2 make 0.3.
_DIGITS = 9
_NAVIGATION = frozenset(NAVIGATION)


@dataclass
class Movement:
    """Steps about one target that belong together, with what they change.

    Attributes:
        flow: The steps as they are written.
        steps: The steps as they run, without the reset's motion to the first target.
        reads: World facts that the steps need.
        before: Values, before them, of every fact or pattern that they write; the hand included, the robot's pose not.
    """

    subtasks: list[SimpleTask]
    flow: list[Action] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    reads: set[Fact] = field(default_factory=set)
    before: dict[Fact, Value] = field(default_factory=dict)
    after: dict[Fact, Value] = field(default_factory=dict)

    @property
    def target(self) -> str:
        """Id of the object that it is about."""
        return self.subtasks[0].target

    @property
    def navigates(self) -> bool:
        """True when it does not depend on the robot's pose."""
        return self.flow[0].primitive in _NAVIGATION

    @property
    def begins_part(self) -> bool:
        """True when the hand is empty before it and the robot's pose does not matter."""
        return self.navigates and self.before[HAND] == EMPTY

    @property
    def carries(self) -> bool:
        """True when its target is in the hand and moves."""
        return any(fact[:2] in _places(self.target) for fact in self.before)

    def does(self, *primitives: Primitive) -> bool:
        """True when one of its steps is one of some primitives."""
        return any(action.primitive in primitives for action in self.flow)

    def written(self) -> SimpleTask:
        """Return the movement as a subtask; its conditions and name state what it changes."""
        target = self.target
        rests = [fact for fact, value in self.before.items() if value is True and fact[:2] in _places(target)]
        held = (("inside", target, GRIPPER),)
        given = held if self.before[HAND] == holding(target) else tuple(rests)
        init, goal = _all(held if given == held else ()), _all(())
        words, support_goal = f"handle {target}", None
        opened = self.after.get(("open", target))
        places = [fact for fact, value in self.after.items() if value is True and fact[:2] in _places(target)]
        placed = places[0] if places and self.does(Primitive.UNGRASP) else None
        if self.does(*ARTICULATIONS) and opened is not None:
            was = self.before["open", target]
            given = () if was is None else (("open", target),)
            init, goal = _all(given, was is True), _all((("open", target),), opened is True)
            words = f"{'open' if opened else 'close'} {target}"
        elif self.after[HAND] == holding(target) != self.before[HAND]:
            left = tuple(fact for fact in rests if self.after[fact] is False)
            init, goal = _all(given), _all(left, False) if left else _all(held)
            words = f"pick up {target}"
        elif placed is not None:
            init, goal, support_goal = _all(given), _all((placed,)), placed[2]
            words = f"put {target} {'inside' if placed[0] == 'inside' else 'on'} {placed[2]}"
        supports = {fact[2] for fact in given if len(fact) == 3}
        planned = all(subtask.flow is not None for subtask in self.subtasks)
        return SimpleTask(
            words.replace(" ", "_"),
            f"{words[0].upper()}{words[1:]}.",
            target,
            next((s.support_init for s in self.subtasks if s.support_init in supports), None),
            self._goes_to() if support_goal is None else support_goal,
            init,
            goal,
            merge_moves(self.flow) if planned else None,
        )

    def _goes_to(self) -> str | None:
        named = (subtask.support_goal for subtask in self.subtasks if subtask.support_goal is not None)
        return next(named, None) if self.does(Primitive.NAVIGATE_TO_SUPPORT) else None


def movements(task: Task, planned: Task, trace: Trace) -> list[Movement]:
    """Return the movements of a proved plan, without those that change nothing."""
    found = _cut(task, planned, trace)
    covered = _by_pattern(trace)
    state, time = trace.start, START
    for movement in found:
        written: set[Fact] = set()
        movement.before[HAND] = state.hand
        for step in movement.steps:
            for fact, _ in step.effect:
                if fact not in written and fact not in (NEAR, EEF):
                    written.add(fact)
                    # Other instances of a pattern have the pattern's own value.
                    for instance in (fact, *covered.get(fact, ())):
                        movement.before.setdefault(instance, state.value(instance))
            time += 2
            state = state.after(step.effect, time)
        movement.after = {fact: state.value(fact) for fact in movement.before}
    if found and found[0].before[HAND] == EMPTY and not found[0].navigates:
        # Add the reset's motion to the first target, so that the first movement can stand anywhere.
        found[0].flow.insert(0, Action(Primitive.NAVIGATE_TO_TARGET))
    return _without_idle(found)


def _cut(task: Task, planned: Task, trace: Trace) -> list[Movement]:
    """Return a plan's steps cut into movements; a subtask without steps has none."""
    found: list[Movement] = []
    reads = _reads(trace)
    for number, (step, following) in enumerate(pairwise((*trace.steps, None))):
        if step is None or (following is not None and {step.primitive, following.primitive} <= _NAVIGATION):
            # A second drive at once makes the first one pointless and carries the same item.
            continue
        subtask = task.subtasks[step.subtask]
        if not found or _begins(found[-1], subtask, step):
            found.append(Movement([]))
        movement = found[-1]
        if not any(subtask is other for other in movement.subtasks):
            movement.subtasks.append(subtask)
        movement.flow.append((planned.subtasks[step.subtask].flow or ())[step.position])
        movement.steps.append(step)
        movement.reads |= reads.get(number, set())
    return found


def _begins(movement: Movement, subtask: SimpleTask, step: Step) -> bool:
    """Decide whether a step begins a new movement: the hand is at rest, or the target is another one."""
    supports = {subtask.support_goal, *(other.support_goal for other in movement.subtasks)} - {None}
    if subtask.target != movement.target or len(supports) > 1:
        return True
    if step.hand == EMPTY and step.primitive is Primitive.APPROACH:
        return movement.does(Primitive.UNGRASP)
    at_rest = step.hand == EMPTY or (step.hand == holding(subtask.target) and movement.does(Primitive.GRASP))
    return at_rest and step.primitive in _NAVIGATION


def _reads(trace: Trace) -> dict[int, set[Fact]]:
    found: dict[int, set[Fact]] = {}
    for obligation in trace.obligations:
        if obligation.kind == "precondition":
            facts = {link.condition.fact for link in obligation.links if len(link.condition.fact) > 1}
            found.setdefault(obligation.time // 2, set()).update(facts)
    return found


def _by_pattern(trace: Trace) -> dict[Fact, list[Fact]]:
    """Return the facts that are written individually, by each pattern that covers them."""
    effects = chain(((fact for fact, _ in trace.start.entries()),), ((f for f, _ in s.effect) for s in trace.steps))
    found: dict[Fact, list[Fact]] = {}
    for fact in dict.fromkeys(fact for effect in effects for fact in effect if ANY not in fact):
        for pattern in generalisations(fact)[1:]:
            found.setdefault(pattern, []).append(fact)
    return found


def _without_idle(found: Sequence[Movement]) -> list[Movement]:
    """Return the movements without those that change nothing, and without pairs that pick up a thing and put it back.

    Later movements must not depend on the robot's pose.
    """
    kept: list[Movement] = []
    for movement in reversed(found):
        if _is_free(kept) and _is_idle(movement.before, movement.after):
            continue
        kept.append(movement)
        picks_up = movement.after[HAND] == holding(movement.target)
        if picks_up and len(kept) > 1 and kept[-2].target == movement.target and _is_free(kept[:-2]):
            last = kept[-2]
            if _is_idle({**last.before, **movement.before}, {**movement.after, **last.after}):
                del kept[-2:]
    return kept[::-1]


def _is_free(later: Sequence[Movement]) -> bool:
    return not later or later[-1].navigates


def _is_idle(before: Mapping[Fact, Value], after: Mapping[Fact, Value]) -> bool:
    return all(after[fact] == value for fact, value in before.items())


def _places(target: str) -> tuple[Fact, ...]:
    return tuple((relation, target) for relation in RESTING)


def _all(facts: Iterable[Fact], value: bool = True) -> bddl.Formula:
    atoms = (bddl.Atom(fact[0], fact[1:]) for fact in facts)
    return sorted_conjunction(atom if value else bddl.Not(atom) for atom in atoms)


def merge_moves(flow: Sequence[Action]) -> ActionFlow:
    """Return a flow in which consecutive moves of one kind are merged into the fewest moves within the largest one.

    Moves with open numbers stay as they are.
    """
    merged: list[Action] = []
    for primitive, group in groupby(flow, key=lambda action: action.primitive):
        # What is merged is no longer than what every robot's hand can do.
        largest = PAPER_ROBOT.longest_motion_m(primitive) or _LARGEST.get(parameter_kind(primitive))
        for known, part in groupby(group, key=lambda action: isinstance(action.parameter, int | float)):
            actions = tuple(part)
            if largest is None or not known or len(actions) == 1:
                merged.extend(actions)
                continue
            numbers = (action.parameter for action in actions)
            left = round(math.fsum(number for number in numbers if isinstance(number, int | float)), _DIGITS)
            while left > largest:
                merged.append(Action(primitive, largest))
                left = round(left - largest, _DIGITS)
            merged.append(Action(primitive, left))
    return tuple(merged)


# Place of an object in the room: a part that touches it depends on the part that moved it last.
_WHERE = "where"


@dataclass
class _Part:
    """Movements that stay together, with what they read and write.

    Attributes:
        fixed: True when nothing may be exchanged with it, since the hand is not empty before it.
        writes: Facts whose known value they change.
        blurs: Facts that they make unknown; doing so twice is no conflict.
    """

    fixed: bool
    subtasks: list[SimpleTask] = field(default_factory=list)
    reads: set[Fact] = field(default_factory=set)
    writes: set[Fact] = field(default_factory=set)
    blurs: set[Fact] = field(default_factory=set)

    def add(self, movement: Movement) -> None:
        """Add a movement at the end."""
        subtask = movement.written()
        self.subtasks.append(subtask)
        self.reads |= movement.reads
        self.reads |= {(_WHERE, name) for name in (subtask.support_init, subtask.support_goal) if name is not None}
        (self.writes if movement.carries else self.reads).add((_WHERE, subtask.target))
        for fact, value in movement.after.items():
            if fact != HAND:
                (self.blurs if value is None else self.writes).add(fact)

    def depends_on(self, other: _Part) -> bool:
        """Decide whether the order of two parts matters: one writes what the other reads or writes."""
        return self.fixed or other.fixed or self._disturbs(other) or other._disturbs(self)

    def _disturbs(self, other: _Part) -> bool:
        read = not (self.writes.isdisjoint(other.reads) and self.blurs.isdisjoint(other.reads))
        return read or not (self.writes.isdisjoint(other.writes) and self.blurs.isdisjoint(other.writes))


def ordered(movements: Sequence[Movement]) -> tuple[SimpleTask, ...]:
    """Return movements as subtasks, independent parts in their canonical order.

    The level of a part is the length of the longest chain of dependent parts that ends with it. A level is sorted by
    text.
    """
    parts: list[_Part] = []
    for movement in movements:
        if not parts or movement.begins_part:
            parts.append(_Part(fixed=movement.before[HAND] != EMPTY))
        parts[-1].add(movement)
    levels: list[int] = []
    for index, part in enumerate(parts):
        earlier = zip(parts[:index], levels, strict=True)
        levels.append(max((level + 1 for other, level in earlier if part.depends_on(other)), default=0))
    texts = (json.dumps(list(map(content, part.subtasks)), sort_keys=True) for part in parts)
    keyed = sorted(zip(levels, texts, range(len(parts)), strict=True))
    return tuple(subtask for _, _, index in keyed for subtask in parts[index].subtasks)


def content(subtask: SimpleTask) -> dict[str, object]:
    """Return a subtask without its name and description, as JSON values."""
    unnamed = ("task_activity_name", "task_detail_message")
    return {key: value for key, value in subtask.to_json().items() if key not in unnamed}


def canonical(task: Task, scene: Scene | None = None) -> Task:
    """Return the canonical form of a task; its verdict is the task's, and its canonical form is itself.

    Names are resolved to the scene's ids, and formulas sorted. A PROVED plan is then cut again where the hand is at
    rest. The conditions of each part state what it changes. Parts that change nothing are dropped, and independent
    parts are put in one order. A plan that is not proved, or that names a part or a spot, keeps its subtasks. The scene
    is by default the task's own.

    Source: docs/semantics.md, Canonical form.
    """
    chosen = chosen_scene(task, scene)
    named = _named(task, chosen)
    planned, trace = _proved(named, chosen)
    # Facts do not tell parts and spots apart: what names one is not cut again.
    if trace is None or any(subtask.where is not None for subtask in named.subtasks):
        return named
    subtasks = ordered(movements(named, planned, trace))
    form = replace(named, subtasks=subtasks, goal=named.goal if named.goal_given else default_goal(subtasks))
    # A rounded sum of moves or a new default goal must not change the verdict; then the named form is kept.
    return named if _proved(form, chosen)[1] is None else form


def canonical_digest(task: Task, scene: Scene | None = None, *, flows: bool = True) -> str:
    """Return the SHA-256 of a task's canonical form: its goal and its subtasks, without names and descriptions.

    Without `flows`, decompositions alone are compared: the five-tuples of the subtasks.
    """
    return digest_of_form(canonical(task, scene), flows=flows)


def digest_of_form(form: Task, *, flows: bool = True) -> str:
    """Return the digest of a task that is in canonical form."""
    rows = [content(subtask) for subtask in form.subtasks]
    if not flows:
        rows = [{key: value for key, value in row.items() if key != "flow"} for row in rows]
    scales = dict(sorted(form.scales.items()))
    return digest({"goal": bddl.format(form.goal), "scales": scales, "sub_tasks": rows})


def _named(task: Task, scene: Scene) -> Task:
    task = with_scene_names(task, resolver(scene))
    subtasks = tuple(replace(s, init=normalize(s.init), goal=normalize_goal(s.goal, s.target)) for s in task.subtasks)
    # A factor of one changes no size; for an unknown object it is a mistake and is kept.
    scales = {name: scale for name, scale in sorted(task.scales.items()) if scale != 1.0 or name not in scene.objects}
    return replace(task, goal=normalize(task.goal), subtasks=subtasks, scales=scales)


def _proved(task: Task, scene: Scene) -> tuple[Task, Trace | None]:
    """Return a plan with a flow for every subtask, and its trace; None when it is not proved."""
    planned = complete(task, scene).task
    if check(planned, scene):
        return planned, None
    trace = follow(planned, scene)
    open_ends = trace.failures or trace.assumptions or trace.undecided_from is not None
    return planned, None if open_ends else trace
