"""PDDL 2.1 out and in: STRIPS with types and negative preconditions; what cannot be expressed so is refused by name.

Out, a scene and a goal become a grounded domain and its problem: the rows of the primitives for every target, support
and place that plans may have. A predicate that can be unknown becomes two, `p` for "known to hold" and `not-p` for
"known not to hold", so that a plan of any STRIPS planner is one that `verify` follows. In: `oag.pddl_reading`.

Source: Fox and Long, PDDL2.1 (JAIR 2003), level 1; Palacios and Geffner, Compiling Uncertainty Away (JAIR 2009) for
the two predicates (their K_0); docs/semantics.md, Own domains.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain, count, product
from typing import NamedTuple

import bddl
from oag.acting import effect_literals, own_subtask, own_subtasks
from oag.compilation import articulated_ids
from oag.model.actions import Action
from oag.model.domain import KINDS, THING, Own, bound, marked, own_of
from oag.model.reading import formula_of
from oag.model.scene import Scene
from oag.model.symbols import (
    ARTICULATIONS,
    EEF,
    EMPTY,
    GRIPPER,
    HAND,
    NEAR,
    ROBOT_FACTS,
    Condition,
    Fact,
    Kind,
    Primitive,
    Value,
    carries_things,
    condition_of,
    generalisations,
    gripping,
    held_by,
    holding,
    takes_things,
)
from oag.pddl_reading import REQUIREMENTS as REQUIREMENTS
from oag.pddl_reading import PddlError as PddlError
from oag.pddl_reading import read as read
from oag.planning import scales_of
from oag.primitives.cargo import Carriage, is_place
from oag.primitives.state import carriage_in, scene_facts, start_state
from oag.primitives.table import NAVIGATION, Clause, Context, Placement, Rows, open_at_top, own_places
from oag.sizes import TO_THE_AIM, Gripper
from oag.task_definition import SimpleTask, Task

_MOST_ACTIONS, _MOST_VARIANTS = 20_000, 64
_NOTHING: bddl.Formula = bddl.And(())


class Part(NamedTuple):
    """An action of an exported domain: one primitive in one subtask, and the hand's value."""

    primitive: Primitive
    target: str
    support: str | None = None
    placement: Placement | None = None
    hand: Value = None


@dataclass(frozen=True)
class Exported:
    """A planning problem as PDDL texts.

    Attributes:
        domain: Text of the domain. Its actions have parameters only where the scene's domain is without the robot.
        problem: Text of the problem.
        actions: What each action without parameters stands for.
        names: The objects by their names in the texts.
    """

    domain: str
    problem: str
    scene: Scene = field(repr=False)
    goal: bddl.Formula = field(repr=False)
    actions: Mapping[str, Part] = field(repr=False)
    names: Mapping[str, str] = field(repr=False)

    def task(self, plan: Iterable[str]) -> Task:
        """Return a planner's plan, a list of actions such as `(stack a b)`, as a task to `verify`.

        Raises:
            PddlError: Something is no action of the domain.
        """
        # Planners write comments, such as the cost, and empty lines between actions.
        steps = [step for line in plan if (step := line.partition(";")[0].strip().strip("()").lower().split())]
        subtasks = self._grounded(steps) if self.actions else [self._lifted(step) for step in steps]
        scales = scales_of(subtasks, self.scene)
        return Task("planned", "", self.goal, True, tuple(subtasks), scales, self.scene)

    def _lifted(self, step: list[str]) -> SimpleTask:
        rows = {_pddl_name(name): row for name, row in self.scene.domain.rows.items()}
        name, *names = step or [""]
        if name not in rows or len(names) != len(rows[name].objects) or not set(names) <= self.names.keys():
            raise PddlError([f"({' '.join(step)}) is no action of the exported domain"])
        target, *rest = (self.names[each] for each in names)
        own = Own(rows[name], tuple(rest[1:]))
        return own_subtask(self.scene.domain, own, target, rest[0] if rest else None)

    def _grounded(self, steps: list[list[str]]) -> list[SimpleTask]:
        unknown = [
            f"({' '.join(step)}) is no action of the exported domain" for step in steps if step[0] not in self.actions
        ]
        if unknown:
            raise PddlError(unknown)
        groups: list[list[Part]] = []
        for part in (self.actions[step[0]] for step in steps):
            last = groups[-1] if groups else []
            if last and (last[-1][1:4] == part[1:4] or _joins(last, part)):
                last.append(part)
            else:
                groups.append([part])
        return [_subtask(group) for group in groups]


def _joins(group: list[Part], part: Part) -> bool:
    """Decide whether actions that only reach for a target begin the subtask of the next action."""
    reaching = (Primitive.NAVIGATE_TO_TARGET, Primitive.APPROACH, Primitive.CONVERGE)
    return all(each.primitive in reaching for each in group) and group[-1].target == part.target


def _subtask(group: list[Part]) -> SimpleTask:
    """Return actions of one target and place as a subtask, whose goal is what they bring about."""
    target, support, placement = group[-1][1:4]
    wanted: dict[bddl.Formula, None] = {}
    for primitive in (part.primitive for part in group):
        is_open, own = bddl.Atom("open", (target,)), own_of(primitive)
        if primitive in ARTICULATIONS:
            wanted = {is_open if primitive is Primitive.ARTICULATE_OPEN else bddl.Not(is_open): None}
        elif own is not None:
            wanted |= dict.fromkeys(
                each for each in effect_literals(own, target, support) if isinstance(each, bddl.Atom)
            )
        elif primitive is Primitive.UNGRASP and placement is not None:
            wanted = {bddl.Atom(placement.relation, (target, placement.support)): None}
        elif primitive is Primitive.LIFT_EEF_UP:
            wanted = {bddl.Atom("inside", (target, GRIPPER)): None}
    goal = next(iter(wanted)) if len(wanted) == 1 else bddl.And(tuple(wanted))
    words = "_".join((group[-1].primitive.name.split()[0].lower(), target, *(() if support is None else (support,))))
    return SimpleTask(words, "", target, None, support, _NOTHING, goal, tuple(Action(part.primitive) for part in group))


def export(scene: Scene, goal: bddl.Formula | str) -> Exported:
    """Return a scene and a goal as a PDDL domain and its problem.

    Raises:
        PddlError: The goal is no conjunction of literals, cargo changes what steps write, geometry found something
            impossible, a row of a domain without the robot has alternatives, patterns or numbers, or there is too much.

    Example:
        >>> import oag
        >>> scene = oag.scene({"drawer_0": "drawer"}, closed="all")
        >>> print(export(scene, "(open drawer_0)").problem.splitlines()[-1])
          (:goal (and (open drawer_0))))
    """
    wanted = formula_of(goal, "goal", scene.domain)
    if bddl.literals(wanted) is None:
        raise PddlError([f"the goal {bddl.format(wanted)}, which is no conjunction of literals"])
    if scene.known:
        raise PddlError(["what geometry found impossible in the scene"])
    names = {_pddl_name(key): key for key in scene.objects}
    if len(names) < len(scene.objects):
        raise PddlError(["objects whose names differ in the case of letters or in signs alone"])
    if not scene.domain.inherits:
        return Exported(*_lifted_texts(scene, wanted), scene, wanted, {}, names)
    exporting = _Export(scene, wanted)
    texts = exporting.texts()
    return Exported(*texts, scene, wanted, exporting.actions, names)


def _pddl_name(name: str) -> str:
    word = re.sub(r"[^a-z0-9_-]", "_", name.lower())
    return word if word[0].isalpha() else f"n{word}"


def _atom(predicate: str, names: Iterable[str]) -> str:
    return f"({' '.join((predicate, *map(_pddl_name, names)))})"


class _Export:
    """The export of a scene with the robot: every action has its objects in its name.

    Attributes:
        actions: What each action stands for.
    """

    def __init__(self, scene: Scene, goal: bddl.Formula) -> None:
        self.scene, self.actions = scene, dict[str, Part]()
        self._goal = [condition_of(literal.atom, literal.value) for literal in bddl.literals(goal) or ()]
        self._start = start_state(scene, None)
        every = list(dict.fromkeys((*self._parts(), *self._own_parts())))
        self._carriage = self._carried(every)
        parts = [part for part in every if not self._unusable(part)]
        self._rows = {part: self._row(part) for part in parts}
        self._written = {fact for _, writes in self._rows.values() for fact in writes}
        read = (each.fact for needs, _ in self._rows.values() for clause in needs for each in clause)
        facts = dict.fromkeys((*(each.fact for each in self._goal), *read))
        self._facts = [fact for fact in facts if fact not in ROBOT_FACTS]
        self._open = self._unknown()

    def _parts(self) -> Iterator[Part]:
        """Yield the primitives with their targets and places, for the hands with which they are of use."""
        asked = {each.fact for each in self._goal}
        for name, thing in self.scene.objects.items():
            grip = holding(name) if thing.kind is Kind.ITEM else gripping(name)
            for primitive in () if thing.kind in (Kind.SUPPORT, Kind.FIXED) else _REACHING:
                yield Part(primitive, name, hand=EMPTY)
            if thing.kind is Kind.ARTICULATED:
                yield from (Part(primitive, name, hand=grip) for primitive in (*ARTICULATIONS, Primitive.UNGRASP))
            if thing.kind is Kind.ITEM:
                yield from (
                    Part(primitive, name, hand=grip) for primitive in (Primitive.LIFT_EEF_UP, Primitive.RETREAT)
                )
                for placement in self._placements(name, asked):
                    for primitive in (NAVIGATION[1], Primitive.UNGRASP):
                        yield Part(primitive, name, placement.support, placement, grip)
                    yield Part(Primitive.RETREAT, name, placement.support, placement, EMPTY)

    def _placements(self, item: str, asked: set[Fact]) -> Iterator[Placement]:
        for key, other in self.scene.objects.items():
            kinds = {"inside": takes_things, "ontop": carries_things}
            for relation, suits in kinds.items():
                furniture = other.kind is not Kind.ITEM and suits(other.category, other.kind)
                if key != item and (furniture or (relation, item, key) in asked):
                    yield Placement(relation, key)

    def _own_parts(self) -> Iterator[Part]:
        for subtask, own in own_subtasks(self.scene) if self.scene.domain.rows else ():
            target, support = subtask.target, subtask.support_goal
            item = self.scene.objects[target].kind is Kind.ITEM
            yield Part(own.primitive(), target, support)
            yield Part(Primitive.RETREAT, target, support, hand=EMPTY)
            if support is not None:
                yield Part(NAVIGATION[1], target, support, hand=EMPTY)
                yield from (Part(NAVIGATION[1], target, support, hand=holding(target)),) if item else ()

    def _carried(self, parts: list[Part]) -> Carriage:
        """Return who may carry whom; what may carry something stays in place, and a goal that moves it is refused."""
        placed = {(p.placement.relation, p.target, p.placement.support) for p in parts if p.placement is not None}
        for part in parts:
            placed.update(own_places((part.primitive,), part.target, part.support))
        items = {key for key, thing in self.scene.objects.items() if thing.kind is Kind.ITEM}
        carriage = carriage_in(self.scene, items, scene_facts(self.scene), placed)
        self._carriers = {name for name, _ in carriage.riders}
        for each in self._goal:
            moved = held_by(each.value) if each.fact == HAND else each.fact[1] if is_place(each.fact) else None
            if moved in self._carriers and each.grade(self._start.value(each.fact)) is not True:
                problem = f"{each.text()} in the goal: {', '.join(carriage.riding(moved))} may be carried by {moved}"
                raise PddlError([problem])
        return carriage

    def _unusable(self, part: Part) -> bool:
        """Decide whether an action takes what is no longer itself at the hand's size, or moves a carrier."""
        if part.primitive is Primitive.GRASP:
            thing, gripper = self.scene.objects[part.target], Gripper.of(self.scene.robot)
            too_small = thing.kind is Kind.ITEM and TO_THE_AIM.unfit(thing, gripper) is not None
            return too_small or part.target in self._carriers
        own = own_of(part.primitive)
        writes = () if own is None else bound(own, part.target, part.support).writes
        return any(is_place(fact) and fact[1] in self._carriers for fact, _ in writes)

    def _row(self, part: Part) -> tuple[tuple[Clause, ...], dict[Fact, Value]]:
        objects = self.scene.objects
        vessels = tuple(k for k, each in objects.items() if each.kind is Kind.ITEM and open_at_top(each.category))
        is_item, doors = objects[part.target].kind is Kind.ITEM, articulated_ids(self.scene)
        context = Context(part.target, part.support, part.placement, is_item, doors, vessels, self._carriage)
        rows = Rows(context)
        needs, _ = rows.row(part.primitive, part.hand)

        def read(fact: Fact) -> Value:
            # Places of what is moved change; all others that cargo depends on are those of the start.
            return None if fact[1:2] == (part.target,) else self._start.value(fact)

        return needs, dict(rows.written(part.primitive, part.hand, None, read))

    def _unknown(self) -> set[str]:
        """Return the predicates of facts that something reads, and that may be unknown."""
        found = {fact[0] for fact in self._facts if self._start.value(fact) is None and self._dynamic(fact)}
        for _, writes in self._rows.values():
            found |= {fact[0] for fact in self._facts if self._value(fact, writes, True) is None}
        return found

    def _dynamic(self, fact: Fact) -> bool:
        return any(pattern in self._written for pattern in generalisations(fact))

    @staticmethod
    def _value(fact: Fact, writes: Mapping[Fact, Value], otherwise: Value) -> Value:
        return next((writes[pattern] for pattern in generalisations(fact) if pattern in writes), otherwise)

    def texts(self) -> tuple[str, str]:
        """Return the texts of the domain and of the problem."""
        bodies = []
        for part, (needs, writes) in self._rows.items():
            after = self._effect(part, writes)
            # What changes nothing that is read is no action.
            for conditions in self._variants(part, needs) if after else ():
                relation = () if part.placement is None else (part.placement.relation,)
                words = (part.primitive.name, *filter(None, part[1:3]), *relation)
                base = "_".join(map(_pddl_name, words))
                name = next(n for n in chain((base,), (f"{base}_{k}" for k in count(2))) if n not in self.actions)
                self.actions[name] = part
                before = [] if part.hand is None else [self._literal(Condition(HAND, part.hand))]
                before += [text for each in conditions if (text := self._literal(each)) not in before]
                bodies.append(_action(name, "", before, after))
            if len(bodies) > _MOST_ACTIONS:
                raise PddlError([f"more than {_MOST_ACTIONS} actions of this scene"])
        goal = [text for each in self._goal for text in [self._goal_text(each)] if text]
        world = {fact[0]: len(fact) - 1 for fact in self._facts}
        arities = {**_ROBOT_WORDS, **world, **{f"not-{name}": world[name] for name in self._open if name in world}}
        constants = f"\n  (:constants {' '.join(map(_pddl_name, self.scene.objects))} - {THING})"
        return _domain_text(arities, bodies, constants), self._problem(goal)

    def _problem(self, goal: list[str]) -> str:
        known = [(fact, self._start.value(fact)) for fact in self._facts]
        held = self._start.hand
        robot = ["(home)", self._literal(Condition(HAND, held if isinstance(held, str) else EMPTY))]
        init = [text for fact, value in known for text in self._true(fact, value)]
        return _problem_text(self.scene.name, (), [*robot, *init], goal)

    def _true(self, fact: Fact, value: Value) -> list[str]:
        """Return the atoms that hold where a fact has a value."""
        if value is True:
            return [_atom(fact[0], fact[1:])]
        return [_atom(f"not-{fact[0]}", fact[1:])] if value is False and fact[0] in self._open else []

    def _goal_text(self, condition: Condition) -> str:
        if self._dynamic(condition.fact) or condition.fact == HAND:
            return self._literal(condition)
        if condition.grade(self._start.value(condition.fact)) is True:
            return ""
        raise PddlError([f"{condition.text()} in the goal, which no primitive brings about"])

    def _variants(self, part: Part, needs: tuple[Clause, ...]) -> Iterator[tuple[Condition, ...]]:
        """Yield the choices of one alternative of each clause; what never changes is decided here."""
        choices: list[list[Condition]] = []
        for clause in needs:
            left: list[Condition] = []
            for condition in clause:
                fixed = condition.fact == HAND and part.hand is not None
                value = part.hand if fixed else self._start.value(condition.fact)
                fixed = fixed or (condition.fact not in ROBOT_FACTS and not self._dynamic(condition.fact))
                grade = condition.grade(value) if fixed else None
                if grade is True:
                    break
                left += [] if fixed else [condition]
            else:
                choices.append(left)
        if math.prod(map(len, choices)) > _MOST_VARIANTS:
            raise PddlError([f"{part.primitive.name} of {part.target}, with more than {_MOST_VARIANTS} alternatives"])
        yield from product(*choices)

    def _effect(self, part: Part, writes: Mapping[Fact, Value]) -> list[str]:
        """Return the effects on what something reads; deletions come first, as in PDDL."""
        deleted: list[str] = []
        added: list[str] = []
        for fact in self._facts:
            value = self._value(fact, writes, "kept")
            if value != "kept":
                added += self._true(fact, value)
                both = (*self._true(fact, True), *self._true(fact, False))
                deleted += [f"(not {text})" for text in both if text not in added]
        for variable in ROBOT_FACTS:
            if variable in writes:
                now = self._literal(Condition(variable, str(writes[variable])))
                before = [self._literal(Condition(HAND, part.hand))] if variable == HAND and part.hand else None
                words = self._values(variable) if before is None else before
                deleted += [f"(not {text})" for text in words if text != now]
                added.append(now)
        return [*deleted, *added]

    def _values(self, variable: Fact) -> list[str]:
        """Return the atoms of all values of one of the robot's variables."""
        words = {NEAR: ("near",), EEF: ("at", "before"), HAND: ("holding", "gripping")}[variable]
        plain = {NEAR: (), EEF: ("home", "free"), HAND: ("handempty",)}[variable]
        return [f"({word})" for word in plain] + [_atom(word, (key,)) for word in words for key in self.scene.objects]

    def _literal(self, condition: Condition) -> str:
        fact, value, positive = condition
        if fact in ROBOT_FACTS:
            word, _, name = str(value).rpartition(" ") if fact != NEAR else ("near", "", str(value))
            if not word:
                word, name = {EMPTY: "handempty"}.get(name, name), ""
            text = _atom(word, (name,)) if name else f"({word})"
        else:
            positive = (value is True) is positive
            text = _atom(fact[0], fact[1:])
            if not positive and fact[0] in self._open:
                return _atom(f"not-{fact[0]}", fact[1:])
        return text if positive else f"(not {text})"


# Predicates of the robot in exported domains, with the number of their arguments.
_ROBOT_WORDS = {"near": 1, "at": 1, "before": 1, "home": 0, "free": 0, "handempty": 0, "holding": 1, "gripping": 1}
_LIFTING = (Primitive.LIFT_EEF_UP, Primitive.RETREAT)
_REACHING = (NAVIGATION[0], Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP, Primitive.RETREAT)


def _action(name: str, parameters: str, before: Iterable[str], after: Iterable[str]) -> str:
    return (
        f"  (:action {name}\n    :parameters ({parameters})\n    :precondition (and {' '.join(before)})\n"
        f"    :effect (and {' '.join(after)}))"
    )


def _domain_text(arities: Mapping[str, int], actions: Iterable[str], declared: str) -> str:
    shapes = [" ".join((name, *(f"?x{index}" for index in range(count)))) for name, count in arities.items()]
    return "\n".join(
        (
            f"(define (domain exported)\n  (:requirements {' '.join(REQUIREMENTS)}){declared}",
            f"  (:predicates {' '.join(f'({shape})' for shape in shapes)})",
            *actions,
            ")",
        )
    )


def _problem_text(name: str, objects: Iterable[tuple[str, str]], init: Iterable[str], goal: Iterable[str]) -> str:
    typed = " ".join(f"{_pddl_name(key)} - {_pddl_name(kind)}" for key, kind in objects)
    listed = f"  (:objects {typed})\n" if typed else ""
    return (
        f"(define (problem {_pddl_name(name)})\n  (:domain exported)\n{listed}"
        f"  (:init {' '.join(init)})\n  (:goal (and {' '.join(goal)})))"
    )


def _lifted_texts(scene: Scene, goal: bddl.Formula) -> tuple[str, str]:
    """Return the texts of a domain without the robot: an action with parameters for each row."""
    domain = scene.domain
    refused = [f"{name}, which is not known completely" for name in domain.predicates if name not in scene.closed]
    for name, row in domain.rows.items():
        refused += [f"{name}: a number"] if row.number is not None else []
        refused += [f"{name}: an unknown effect"] if row.unknown else []
        refused += [f"{name}: alternatives" for each in row.needs if isinstance(each, bddl.Or)]
        refused += [f"{name}: an effect on every object" for each in row.writes if "any" in each.atom.args]
        refused += [f"{name}: the kind {what}" for _, what in row.objects if what in KINDS]
    if refused:
        raise PddlError(refused)
    categories = {*scene.categories.values(), *(what for row in domain.rows.values() for _, what in row.objects)}
    named = dict.fromkeys(each for category in sorted(categories) for each in domain.line(category))
    typed = [(each, domain.types.get(each, THING)) for each in named if each != THING]
    types = "\n  (:types " + " ".join(f"{_pddl_name(a)} - {_pddl_name(b)}" for a, b in typed) + ")" if typed else ""
    actions = []
    for name, row in domain.rows.items():
        parameters = " ".join(f"?{variable} - {_pddl_name(what)}" for variable, what in row.objects)
        after = sorted(row.writes, key=lambda each: each.value)
        words = [[marked(each.formula) for each in part] for part in (_literals_of(row.needs), after)]
        actions.append(_action(_pddl_name(name), parameters, *words))
    arities = {name: spec.arity for name, spec in domain.predicates.items()}
    start = [(each.atom, each.value) for fact in scene.facts for each in bddl.literals(fact) or ()]
    init = [_atom(atom.predicate, atom.args) for atom, value in start if value]
    ends = [(each.atom, each.value) for each in bddl.literals(goal) or ()]
    texts = [_atom(atom.predicate, atom.args) for atom, _ in ends]
    wanted = [text if value else f"(not {text})" for text, (_, value) in zip(texts, ends, strict=True)]
    return (
        _domain_text(arities, actions, types),
        _problem_text(scene.name, scene.categories.items(), init, wanted),
    )


def _literals_of(formulas: Iterable[bddl.Formula]) -> Iterator[bddl.Literal]:
    return (literal for formula in formulas for literal in bddl.literals(formula) or ())
