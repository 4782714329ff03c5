"""A plan from a goal, and what is left of a plan from a state: both are searched, and then proved by `verify`.

The operators are simple tasks (open, close, pick up, put) with their usual flows; what they need and write is computed
by the table of primitives. A goal becomes literals by `bddl.options`, so that quantifiers and alternatives are spelled
out over the scene. A* counts subtasks; its estimate adds up what literals still need. A repair follows the given plan
as well: keeping a subtask is free; leaving one out, replacing one, and inserting one are edits. Of equal plans the one
with fewer subtasks is taken. What `verify` finds fault with is not tried again.

Source: Hart, Nilsson and Raphael, A Formal Basis for the Heuristic Determination of Minimum Cost Paths (1968);
Fox, Gerevini, Long and Serina, Plan Stability: Replanning versus Plan Repair (ICAPS 2006), for the measure.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from heapq import heappop, heappush
from itertools import chain, count, islice
from typing import Literal, NamedTuple

import bddl
from oag.acting import own_subtasks, relevant
from oag.compilation import CompiledSubtask, compile_plan, facts_read, literals_in
from oag.flows import complete, taking
from oag.model.actions import Action, ActionFlow
from oag.model.codec import brief
from oag.model.diagnostics import SceneError, TaskError
from oag.model.domain import bound, own_of
from oag.model.reading import facts_of, formula_of
from oag.model.scene import FLOOR, Scene
from oag.model.symbols import (
    GRIPPER,
    HAND,
    Condition,
    Fact,
    Kind,
    Primitive,
    Value,
    condition_of,
    fact_text,
    held_by,
    overlap,
)
from oag.planning_estimate import Estimate
from oag.primitives.cargo import RESTING, below
from oag.primitives.state import State, View, Window, contradictions, start_state, step
from oag.primitives.table import Needed, Placement, needed
from oag.sizes import TO_THE_AIM, Gripper, Sizing
from oag.task_definition import SimpleTask, Task, chosen_scene, required_scene
from oag.verify.fix_subtasks import closing, opening, picking, placing
from oag.verify.verify import Report, Verdict, verify
from oag.wellformed import check, kind_problem

MOST_TRIED = 8_000
"""Subtasks that one search follows: about two seconds. Long plans of large scenes take some hundreds."""
MOST_GOALS = 48
"""Ways to meet a goal that one search aims at, those that change least of the start first."""
_MOST_DRAWN = 1_000
# Places for a thing that is only in the way; the first of them is where it was.
_MOST_PARKED = 4
# Plans that `verify` may find fault with before the search gives up.
_MOST_REJECTED = 12
_NOTHING: bddl.Formula = bddl.And(())

RefusalCode = Literal["impossible", "unknown", "no-plan", "too-large", "not-proved"]
# What is well formed, and yet no goal to plan for.
_NO_GOAL_CODES: dict[str, RefusalCode] = {
    "bddl/kind": "impossible",
    "task/contradictory": "impossible",
    "bddl/too-many-instances": "too-large",
}


@dataclass(frozen=True, slots=True)
class NoPlan:
    """Why there is no plan.

    Attributes:
        code: `impossible` when no primitive changes what has to change, `unknown` when the scene does not say what
            the plan rests on, `no-plan` when every order of subtasks was tried, `too-large` when the search ended at
            its bound, `not-proved` when `verify` finds fault with every plan that was found.
        problem: What is missing, in one sentence.
        literals: The parts of the goal that no plan reaches.
        states: States that were searched.
    """

    code: RefusalCode
    problem: str
    literals: tuple[str, ...] = ()
    states: int = 0

    def __repr__(self) -> str:
        return brief(f"<NoPlan {self.code}: {self.problem}>")

    def __str__(self) -> str:
        """Return the reason in one line."""
        return f"no plan ({self.code}): {self.problem}"

    def to_json(self) -> dict[str, object]:
        """Return the reason as JSON values."""
        return {
            "code": self.code,
            "problem": self.problem,
            "literals": list(self.literals),
            "states": self.states,
        }


@dataclass(frozen=True, slots=True)
class Planned:
    """The result of a search for a plan; true when there is one, which is proved.

    Attributes:
        goal: The goal as it was given.
        task: The plan, without subtasks where the goal holds already; None when there is none.
        report: The proof of the plan; of a refused one the last report, if any.
        refusal: Why there is no plan; None when there is one.
        edits: Of a repair, the subtasks inserted, replaced or left out in a rest of the given plan.
        states: States that were searched.
    """

    goal: bddl.Formula
    task: Task | None
    report: Report | None
    refusal: NoPlan | None
    edits: int = 0
    states: int = 0

    def __bool__(self) -> bool:
        return self.task is not None

    def __repr__(self) -> str:
        found = repr(self.task) if self.task is not None else str(self.refusal)
        return brief(f"<Planned {found}>")


def plan(
    scene: Scene,
    goal: bddl.Formula | str,
    *,
    name: str = "task",
    sizing: Sizing = TO_THE_AIM,
) -> Planned:
    """Return a shortest proved plan from a scene's start to a goal, or why there is none.

    Args:
        scene: The scene; what it does not know counts as unknown, and no plan rests on it.
        goal: A formula or its text, quantifiers included. What holds already is left as it is.
        name: Name of the task.
        sizing: Rule for the sizes of what the hand takes; the factors are the task's `scales`.

    Raises:
        TaskError: The goal cannot be read, or names what the scene lacks.
        SceneError: The facts of the scene contradict each other, or say what a kind excludes.

    Example:
        >>> import oag
        >>> scene = oag.Scene.from_json({"objects": {"box_0": {"category": "drawer", "bbox_extent": [1, 1, 1]}}})
        >>> [subtask.name for subtask in oag.plan(scene, "(exists (?d - drawer) (open ?d))").task.subtasks]
        ['open_box_0']
    """
    required_scene(scene)
    wanted = formula_of(goal, "goal", scene.domain)
    return _Planning(Task(name, "", wanted, True, (), scene=scene), scene, sizing).run()


def repair(task: Task, state: Scene | Iterable[bddl.Formula | str], *, sizing: Sizing = TO_THE_AIM) -> Planned:
    """Return what is left of a plan from a state, changed as little as possible, or why no plan is left.

    A beginning of the plan that is done falls away. In the rest the fewest subtasks are inserted, replaced or left out;
    of plans that change as little, the shortest is taken. A kept subtask keeps its flow and its numbers; where it
    assumed that the base stands at its target, it drives there first.

    Args:
        task: The plan; its task goal is kept.
        state: What detectors read: a scene with these facts, or the facts of the task's own scene. Of the scene's
            closed predicates, what is not listed is false.
        sizing: Rule for the sizes of what the hand takes in addition.

    Raises:
        MissingScene: Facts are given, and the task carries no scene.
        TaskError, SceneError: The task or the facts do not fit the scene.
    """
    facts = () if isinstance(state, Scene) else facts_of(state)
    scene = state if isinstance(state, Scene) else replace(chosen_scene(task, None), facts=facts)
    given = complete(task, scene if task.scene is None else task.scene).task
    return _Planning(replace(given, scene=scene), scene, sizing).run()


def scales_of(subtasks: Iterable[SimpleTask], scene: Scene, sizing: Sizing = TO_THE_AIM) -> dict[str, float]:
    """Return the factors of the sizes of what some subtasks take."""
    gripper = Gripper.of(scene.robot)
    taken = (scene.objects[subtask.target] for subtask in subtasks)
    factors = ((thing.id, sizing.factor(thing, gripper)) for thing in taken if thing.kind is Kind.ITEM)
    return {key: factor for key, factor in factors if factor != 1.0}


class _Operator(NamedTuple):
    """A subtask that the search may use, ready for progression; `number` tells operators apart."""

    number: int
    subtask: SimpleTask
    compiled: CompiledSubtask


class _Node(NamedTuple):
    """A partial plan.

    Attributes:
        state: What is known at its end.
        rest: Index of the next subtask of the given plan.
        edits: Changes of the given plan so far.
        steps: The subtasks so far, the last one first.
    """

    state: View
    rest: int
    edits: int
    changed_flows: int
    length: int
    steps: tuple[SimpleTask, object] | None

    @property
    def subtasks(self) -> tuple[SimpleTask, ...]:
        """The subtasks in order."""
        found: list[SimpleTask] = []
        steps: object = self.steps
        while isinstance(steps, tuple):
            found.append(steps[0])
            steps = steps[1]
        return tuple(reversed(found))


class _Planning:
    """The search for one goal, with what all its parts share."""

    def __init__(self, task: Task, scene: Scene, sizing: Sizing) -> None:
        self.task, self.scene, self.objects = task, scene, scene.categories
        self.goal: Needed = needed(task.goal)
        self.sizing = sizing
        self.states, self.repairs = 0, bool(task.subtasks)
        self.form = check(replace(task, subtasks=()), scene)
        unfit = next((each for each in self.form if each.field == "facts"), None)
        if unfit is not None:
            raise SceneError(unfit.message, source=scene.name, place="facts", hint=unfit.hint or "")
        wrong = next((each for each in self.form if each.code not in _NO_GOAL_CODES), None)
        if wrong is not None:
            raise TaskError(wrong.message, source="(argument)", place="goal", hint=wrong.hint or "")
        gripper = Gripper.of(scene.robot)
        self.unfit = {
            key: why for key, thing in scene.objects.items() if (why := sizing.unfit(thing, gripper)) is not None
        }

    def run(self) -> Planned:
        """Return the best plan that is proved, or why there is none."""
        for finding in self.form:
            return self._refused(NoPlan(_NO_GOAL_CODES[finding.code], finding.message))
        known = start_state(self.scene, None)
        start = {atom: truth for atom in self._atoms() if (truth := known.holds(atom)) is not None}
        goals, hopeless = self._goals(start)
        if not goals:
            return self._refused(self._why_hopeless(hopeless))
        operators = self._operators(goals, start)
        given = self._given()
        compiled = [operator.compiled for operator in (*operators, *given)]
        window = Window(facts_read(compiled, self.goal, self.objects), self.objects)
        origin = window.view(known)
        banned: set[tuple[object, ...]] = set()
        report: Report | None = None
        for _ in range(_MOST_REJECTED):
            allowed = [operator for operator in operators if _key(operator.subtask) not in banned]
            kept = [operator if _key(operator.subtask) not in banned else None for operator in given]
            context, usable = compiled[0].context if compiled else None, [each.subtask for each in allowed]
            estimate = Estimate(goals, context, self.scene.domain, () if self.repairs else usable)
            found, complete_search = self._search(origin, allowed, kept, estimate)
            if found is None:
                return self._refused(self._why_none(complete_search, report, goals, origin), report)
            planned = self._task(found.subtasks)
            report = verify(planned, self.scene)
            if report.verdict is Verdict.PROVED:
                return Planned(self.task.goal, planned, report, None, found.edits, self.states)
            blamed = {finding.subtask for finding in report.diagnostics if finding.severity != "note"} - {None}
            before = len(banned)
            banned |= {_key(planned.subtasks[index]) for index in blamed if index is not None and index < found.length}
            if len(banned) == before:
                break
        return self._refused(self._why_none(True, report, goals, origin), report)

    def _atoms(self) -> tuple[bddl.Atom, ...]:
        return bddl.ground(self.task.goal, self.objects).atoms

    def _goals(self, start: dict[bddl.Atom, bool]) -> tuple[list[tuple[Condition, ...]], list[bddl.Literal]]:
        """Return ways to meet the goal that the primitives may reach, and literals that rule out the others."""
        # What cannot change has to stay; saying so keeps alternatives out of the search that differ in it alone.
        stays = [bddl.Literal(a, v) for a, v in start.items() if self._hopeless(bddl.Literal(a, not v))]
        fixed = bddl.And((self.task.goal, *(literal.formula for literal in stays)))
        found: list[tuple[Condition, ...]] = []
        for option in self._options(fixed, start, _MOST_DRAWN):
            wanted = [each for each in option if each not in stays]
            if contradictions(option) is None and not any(self._unmet_hopeless(wanted, start)):
                found.append(tuple(condition_of(literal.atom, literal.value) for literal in wanted))
                if len(found) == MOST_GOALS:
                    break
        if found:
            return found, []
        drawn = self._options(self.task.goal, start, MOST_GOALS)
        return [], list(dict.fromkeys(each for option in drawn for each in self._unmet_hopeless(option, start)))

    def _options(
        self, goal: bddl.Formula, start: dict[bddl.Atom, bool], most: int
    ) -> Iterator[tuple[bddl.Literal, ...]]:
        with suppress(bddl.SearchLimit):
            yield from islice(bddl.options(goal, self.objects, start), most)

    @cached_property
    def _own_writes(self) -> frozenset[tuple[Fact, Value]]:
        """What the primitives of the scene's own domain write, with every choice of objects."""
        subtasks = own_subtasks(self.scene) if self.scene.domain.rows else ()
        return frozenset(chain.from_iterable(bound(own, s.target, s.support_goal).writes for s, own in subtasks))

    def _unmet_hopeless(self, option: Iterable[bddl.Literal], start: dict[bddl.Atom, bool]) -> Iterator[bddl.Literal]:
        return (each for each in option if start.get(each.atom) is not each.value and self._hopeless(each))

    def _hopeless(self, literal: bddl.Literal) -> str:
        """Return why no primitive can make a literal hold that does not hold at the start; "" where one may."""
        predicate, *names = literal.atom.label
        objects, written = self.scene.objects, condition_of(literal.atom, literal.value)
        problem = kind_problem(literal.atom, self.scene) if literal.value else None
        if problem is not None:
            return problem.message
        if any(written.grade(value) for fact, value in self._own_writes if overlap(fact, written.fact)):
            return ""
        if predicate not in ("open", *RESTING):
            is_written = predicate in self.scene.domain.written
            return "no primitive brings it about" if is_written else f"no primitive changes {predicate}"
        if names[0] not in objects:
            return f"{names[0]} is no object of the scene"
        if predicate == "open":
            return "" if objects[names[0]].kind is Kind.ARTICULATED else f"{names[0]} has no joint"
        item, place = names
        if objects[item].kind is not Kind.ITEM:
            return f"{item} is furniture, which the robot does not move"
        if item in self.unfit:
            return f"{item} {self.unfit[item]}"
        if literal.value and item == place:
            return f"{item} cannot be {predicate} itself"
        return "" if place == GRIPPER or place in objects else f"the scene has no {place}"

    def _operators(self, goals: Sequence[tuple[Condition, ...]], start: dict[bddl.Atom, bool]) -> tuple[_Operator, ...]:
        """Return the simple tasks that may help: about doors and things of the goals, and what is in the way."""
        state, objects = start_state(self.scene, None), self.scene.objects
        unmet_parts = [each for each in chain.from_iterable(goals) if not each.grade(state.value(each.fact))]
        own, needs = relevant(self.scene, unmet_parts) if self.scene.domain.rows else ([], [])
        # What a given subtask starts with may have to be brought about for it to be kept.
        starts = literals_in(subtask.init for subtask in self.task.subtasks)
        needs += [condition_of(literal.atom, literal.value) for literal in starts]
        goals = [*goals, tuple(each for each in needs if len(each.fact) > 1 or each.fact == HAND)]
        resting = [(fact, entry.value) for fact, entry in state.entries() if len(fact) == 3 and fact[0] in RESTING]
        places: dict[str, dict[Placement, None]] = {}
        unmet: dict[str, None] = {}
        for condition in chain.from_iterable(goals):
            fact, met = condition.fact, condition.grade(state.value(condition.fact))
            item = held_by(condition.value) if fact == HAND else fact[1] if fact[0] in RESTING else None
            if item is None or met:
                continue
            unmet.setdefault(item)
            if fact[0] in RESTING and condition.positive:
                places.setdefault(item, {}).setdefault(Placement(fact[0], fact[2]))
        held = held_by(state.hand)
        unmet |= {} if held is None else {held: None}
        self._add_cargo(goals, state, unmet, places)
        # What has to change before something is possible.
        unmet |= dict.fromkeys(fact[1] for fact in self._circumstances() if fact[0] in RESTING)
        for subtask in self.task.subtasks:
            if subtask.target in objects and objects[subtask.target].kind is Kind.ITEM:
                unmet.setdefault(subtask.target)
        movable = [item for item in unmet if item in objects and item not in self.unfit]
        parts = own
        doors = [key for key, thing in objects.items() if thing.kind is Kind.ARTICULATED]
        asked = {name for condition in chain.from_iterable(goals) for name in condition.fact[1:]}
        asked |= {subtask.target for subtask in self.task.subtasks}
        asked |= {name for fact in self._circumstances() for name in fact[1:]}
        # A shut door is in the way to what is taken, and to where something is put.
        reached = asked.union(movable)
        asked |= {fact[2] for fact, value in resting if value is True and fact[1] in reached}
        asked |= {key for key in doors for item in reached if state.value(("inside", item, key)) is None}
        for door in doors if self.scene.domain.inherits else ():
            if door in asked:
                parts += [opening(door), closing(door)]
                if state.value(("open", door)) is None:
                    # Pulling an open door open does no harm.
                    parts[-2:] = [replace(part, init=_NOTHING) for part in parts[-2:]]
        for item in movable if self.scene.domain.inherits else ():
            now = [Placement(fact[0], fact[2]) for fact, value in resting if value is True and fact[1] == item]
            parked = [Placement("ontop", key) for key in self._surfaces() if key != item]
            ends = dict.fromkeys((*places.get(item, {}), *(p for p in now if p.support in objects)))
            ends |= dict.fromkeys(parked[: max(_MOST_PARKED - len(now), 1)])
            parts += [placing(item, place) for place in ends]
            sources = [place for place in ends if place.support in objects]
            parts += [self._picking(item, place) for place in sources]
            parts.append(self._picking(item, None))
        compiled = compile_plan(parts, self.scene)
        return tuple(map(_Operator, count(), parts, compiled))

    def _add_cargo(
        self,
        goals: Sequence[tuple[Condition, ...]],
        state: State,
        unmet: dict[str, None],
        places: dict[str, dict[Placement, None]],
    ) -> None:
        """Add what may carry a thing to where a goal wants it, or off it, and what has to leave a carrier before."""
        objects = self.scene.objects
        known = {fact for fact, entry in state.entries() if entry.value is True and fact[0] in RESTING}
        resting = {fact for fact in known if objects[fact[1]].kind is Kind.ITEM}
        for goal in goals:
            wanted = {each.fact for each in goal if each.positive and each.fact[0] in RESTING}
            for condition in goal:
                fact = condition.fact
                met = condition.grade(state.value(fact))
                # What holds is lost where the thing is taken for another part of the goal.
                if fact[0] != "inside" or (condition.positive and met and fact[1] not in unmet):
                    continue
                for carrier in below(fact[1], resting | wanted):
                    if carrier not in objects or objects[carrier].kind is not Kind.ITEM or carrier == fact[2]:
                        continue
                    if condition.positive:
                        unmet.setdefault(carrier)
                        places.setdefault(carrier, {}).setdefault(Placement("inside", fact[2]))
                    elif state.value(("inside", carrier, fact[2])) is not False:
                        unmet.setdefault(carrier)
        asked = {name for condition in chain.from_iterable(goals) for name in condition.fact[1:]}
        riders = {fact[1] for fact in resting if not unmet.keys().isdisjoint(below(fact[1], resting))}
        unmet |= dict.fromkeys(sorted(riders & asked))

    def _circumstances(self) -> list[Fact]:
        return [literal.atom.label for each in self.scene.known for literal in literals_in(each.given)]

    def _picking(self, item: str, place: Placement | None) -> SimpleTask:
        part = picking(item, place)
        if place is None:
            # Where it is is unknown, and the hand backs out of whatever that is.
            return replace(part, flow=_flow(taking("inside", "")))
        return replace(part, flow=_flow(taking(place.relation, self.objects[place.support])))

    def _surfaces(self) -> list[str]:
        """Return where a thing can be put that is only in the way: furniture first, the floor and appliances last."""
        objects = self.scene.objects
        tables = [key for key, thing in objects.items() if thing.kind is Kind.SUPPORT]
        tops = [key for key, thing in objects.items() if thing.kind is Kind.ARTICULATED]
        return [*(key for key in tables if key != FLOOR), *tops, *(key for key in tables if key == FLOOR)]

    def _given(self) -> tuple[_Operator, ...]:
        subtasks = [subtask for subtask in self.task.subtasks if subtask.flow is not None]
        if len(subtasks) < len(self.task.subtasks) or (subtasks and check(self.task, self.scene)):
            # Of a plan that is not well formed, only the goal can be kept.
            return ()
        return tuple(map(_Operator, count(), subtasks, compile_plan(subtasks, self.scene)))

    def _search(
        self,
        origin: View,
        operators: Sequence[_Operator],
        given: Sequence[_Operator | None],
        estimate: Estimate,
    ) -> tuple[_Node | None, bool]:
        """Return the best plan, None when there is none, and whether every state was searched."""
        serial = count()
        heap: list[tuple[int, int, int, int, int, _Node]] = []
        least: dict[tuple[View, int], tuple[int, int, int]] = {}
        estimates: dict[View, int] = {}
        tried = 0

        def push(node: _Node) -> None:
            cost, place = (node.edits, node.changed_flows, node.length), (node.state, node.rest)
            if place in least and least[place] <= cost:
                return
            least[place] = cost
            if node.state not in estimates:
                met = node.state.truth(self.goal) is True
                estimates[node.state] = 0 if met else max(1, estimate.of(node.state))
            ahead, left = estimates[node.state], len(given) - node.rest
            # What is left of the given plan is kept for nothing, or else left out.
            edits = node.edits + (max(0, ahead - left) if self.repairs else 0)
            heappush(heap, (edits, node.changed_flows, node.length + ahead, ahead, next(serial), node))

        for rest in range(len(given), -1, -1):
            push(_Node(origin, rest, 0, 0, 0, None))
        while heap:
            *_, node = heappop(heap)
            if (node.edits, node.changed_flows, node.length) > least[node.state, node.rest]:
                continue
            if node.rest == len(given) and estimates[node.state] == 0:
                return node, False
            if tried >= MOST_TRIED:
                return None, False
            self.states += 1
            for after in self._after(node, operators, given):
                push(after)
                tried += 1
        return None, True

    def _after(self, node: _Node, operators: Sequence[_Operator], given: Sequence[_Operator | None]) -> Iterator[_Node]:
        state, rest, edits, changed, length, steps = node
        if rest < len(given):
            kept = given[rest]
            if kept is not None:
                yield from islice(_kept(node, kept), 1)
            yield _Node(state, rest + 1, edits + 1, changed, length, steps)
        for operator in operators:
            end = _run(state, operator.compiled, operator.subtask.flow or ())
            if end is None:
                continue
            added = length + 1, (operator.subtask, steps)
            yield _Node(end, rest, edits + self.repairs, changed, *added)
            if rest < len(given):
                yield _Node(end, rest + 1, edits + 1, changed, *added)

    def _task(self, subtasks: tuple[SimpleTask, ...]) -> Task:
        """Return the plan as a task, with the factors of what the hand takes."""
        scales = {**scales_of(subtasks, self.scene, self.sizing), **self.task.scales}
        return replace(self.task, subtasks=subtasks, scales=scales, goal_given=True, source=None)

    def _refused(self, refusal: NoPlan, report: Report | None = None) -> Planned:
        return Planned(self.task.goal, None, report, replace(refusal, states=self.states), 0, self.states)

    def _why_hopeless(self, hopeless: Sequence[bddl.Literal]) -> NoPlan:
        if not hopeless:
            return NoPlan("impossible", "the goal contradicts itself, or asks for things that exclude each other")
        reasons = dict.fromkeys(f"{bddl.format(each.formula)}: {self._hopeless(each)}" for each in hopeless[:3])
        literals = tuple(bddl.format(each.formula) for each in hopeless)
        return NoPlan("impossible", "; ".join(reasons), literals)

    def _why_none(
        self, complete_search: bool, report: Report | None, goals: Sequence[tuple[Condition, ...]], origin: View
    ) -> NoPlan:
        unmet = [each for each in goals[0] if each.grade(origin.value(each.fact)) is not True]
        literals = tuple(map(Condition.text, unmet))
        if report is not None:
            reason = next((each.message for each in report.diagnostics if each.severity != "note"), "it is not proved")
            return NoPlan("not-proved", f"of the plans found, none is proved; the last one: {reason}", literals)
        unknown = [fact for fact in origin.window.facts if len(fact) > 1 and origin.value(fact) is None]
        if unknown:
            named = ", ".join(fact_text(fact, True) for fact in _first(unknown, unmet))
            return NoPlan(
                "unknown", f"the scene does not say whether {named}; add facts, or close predicates", literals
            )
        if complete_search:
            means = ", ".join(("opening", "closing", "picking up", *self.scene.domain.rows))
            together = " together" if len(literals) > 1 else ""
            reason = f"no order of {means} and putting reaches {', '.join(literals)}{together}"
            return NoPlan("no-plan", reason, literals)
        return NoPlan(
            "too-large", f"{self.states} states were searched for {', '.join(literals)}, and more are left", literals
        )


def _first(unknown: Collection[Fact], unmet: Sequence[Condition]) -> list[Fact]:
    """Return some unknown facts, those about the objects of what is unmet first."""
    about = {name for condition in unmet for name in condition.fact[1:]}
    return sorted(unknown, key=lambda fact: -len(about.intersection(fact[1:])))[:3]


def _key(subtask: SimpleTask) -> tuple[object, ...]:
    return subtask.target, subtask.support_goal, subtask.init, subtask.goal


def _flow(primitives: Iterable[Primitive]) -> ActionFlow:
    return tuple(map(Action, primitives))


def _variants(subtask: SimpleTask) -> Iterator[tuple[ActionFlow, int]]:
    """Yield a given flow, and the same after a drive to the target; with the number of steps that are changed."""
    flow = subtask.flow or ()
    yield flow, 0
    if not flow or (flow[0].primitive is not Primitive.NAVIGATE_TO_TARGET and own_of(flow[0].primitive) is None):
        yield (Action(Primitive.NAVIGATE_TO_TARGET), *flow), 1


def _kept(node: _Node, kept: _Operator) -> Iterator[_Node]:
    """Yield what follows when the next subtask of the given plan is kept, the least changed first."""
    for flow, more in _variants(kept.subtask):
        end = _run(node.state, kept.compiled, flow)
        if end is not None:
            steps, changed = (replace(kept.subtask, flow=flow), node.steps), node.changed_flows + more
            yield _Node(end, node.rest + 1, node.edits, changed, node.length + 1, steps)


def _run(state: View, subtask: CompiledSubtask, flow: ActionFlow) -> View | None:
    """Return what is known after a subtask; None unless all that it needs is known to hold, its goal included."""
    if state.truth(subtask.init) is not True:
        return None
    for action in flow:
        if state.truth(subtask.rows.row(action.primitive, state.hand, action.parameter)[0]) is not True:
            return None
        state = step(state, subtask.rows, action.primitive, action.parameter)[1]
    return state if state.truth(subtask.goal) is True else None
