"""Scenes and tasks written in Python: objects by category, facts as texts, and a plan as a list of steps.

    scene = oag.scene(objects={"drawer_0": "drawer", "apple_0": "apple", "table_0": "table"},
                      facts=["(ontop apple_0 table_0)"], closed="all")
    task = oag.task(scene, goal="(inside apple_0 drawer_0)",
                    steps=[oag.open("drawer_0"), oag.pick("apple_0"), oag.place("apple_0", inside="drawer_0")])

An object without a box has no size: nothing is excluded by its size, and nothing is scaled. The initial condition of a
step is what is known of its object where the step begins; whether the plan works is for `verify` to decide.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import bddl
from oag.acting import read_own_subtask
from oag.compilation import compile_plan
from oag.flows import CLOSE, OPEN, PLACE, taking
from oag.model.actions import Action, ActionFlow
from oag.model.codec import brief, expected, shown
from oag.model.diagnostics import SceneError, TaskError
from oag.model.domain import BUILT_IN, Domain
from oag.model.reading import facts_of, flow_of, formula_of
from oag.model.scene import NO_BOX, RobotPose, Scene, SceneObject, id_problem
from oag.model.symbols import GRIPPER, Kind, Primitive, is_known
from oag.primitives.cargo import RESTING
from oag.primitives.state import START, State, assume_true, start_state, step
from oag.primitives.table import Placement
from oag.task_definition import SimpleTask, Task, default_goal, required_scene

Verb = Literal["open", "close", "pick", "place"]
_NOTHING: bddl.Formula = bddl.And(())
_ARGUMENT = "(argument)"


def scene(
    objects: Mapping[str, str | SceneObject],
    facts: Iterable[bddl.Formula | str] = (),
    closed: Iterable[str] | Literal["all"] = (),
    *,
    name: str = "scene",
    robot: RobotPose | None = None,
    domain: Domain = BUILT_IN,
) -> Scene:
    """Return a scene from categories and facts alone; objects have no boxes unless they are given.

    Args:
        objects: Id -> category, such as `{"drawer_0": "drawer"}`, or -> a `SceneObject` with its box.
        facts: Literals that hold at the start, as formulas or texts.
        closed: Closed-world predicates, of which everything that holds is stated, or "all"; no door is meant.
        name: For people and records.
        robot: Where the robot starts, and how large it is; by default the paper's at the origin.
        domain: The predicates, kinds and primitives of the scene and of plans in it.

    Raises:
        SceneError: An id, a category or a fact cannot be used. A category that is no household noun needs a box, from
            which its kind follows.

    Example:
        >>> import oag
        >>> oag.scene({"drawer_0": "drawer", "apple_0": "apple"}, ["(inside apple_0 drawer_0)"], "all")
        <Scene 'scene': 2 objects, 1 fact>
    """
    given: object = objects
    if not isinstance(given, Mapping):
        raise SceneError(expected("a mapping of ids to categories", objects), source=_ARGUMENT, place="objects")
    if isinstance(closed, str):
        if closed != "all":
            problem = f'expected "all" or a list of predicates, got {shown(closed)}'
            raise SceneError(problem, source=_ARGUMENT, place="closed")
        closed = domain.predicates
    things = {key: _object(key, given, domain) for key, given in objects.items()}
    pose = RobotPose() if robot is None else robot
    return Scene(name, pose, things, facts_of(facts), frozenset(closed), domain=domain)


def _object(key: str, given: object, domain: Domain) -> SceneObject:
    place = f"objects.{key}"
    if isinstance(given, SceneObject):
        return given
    if not isinstance(given, str):
        raise SceneError(expected("a category, such as water_glass", given), source=_ARGUMENT, place=place)
    if problem := id_problem(key, given):
        raise SceneError(problem, source=_ARGUMENT, place=place)
    if domain.kind_of(given) is None and not is_known(given):
        hint = "give a SceneObject with a bbox_extent [m], or a category that ends in a known noun, such as toy_box"
        problem = f"the category {shown(given)} is no known noun, so its kind is not known without a box"
        raise SceneError(problem, source=_ARGUMENT, place=place, hint=hint)
    return SceneObject(key, given, given, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), NO_BOX)


@dataclass(frozen=True, slots=True)
class PlanStep:
    """One step of a plan that `task` writes out as a simple task.

    Attributes:
        verb: What is done: "open", "close", "pick" or "place".
        target: Id of the object that it is done to.
        placement: Where a placed item goes; None for other verbs.
        init: What must hold where it begins; None for what is known there of its object.
        flow: Its actions; None for the usual ones, their numbers left to the executor.
    """

    verb: Verb
    target: str
    placement: Placement | None = None
    init: bddl.Formula | None = None
    flow: ActionFlow | None = None

    def __repr__(self) -> str:
        where = "" if self.placement is None else f" {self.placement.relation} {self.placement.support}"
        return brief(f"<PlanStep {self.verb} {self.target}{where}>")


Condition = bddl.Formula | str | None


def open(fixture: str, *, init: Condition = None, flow: object = None) -> PlanStep:
    """Return the step that opens a door or a drawer.

    Args:
        fixture: Id of the object.
        init: What must hold where the step begins; by default what is known there.
        flow: Actions, or their JSON form; by default the usual ones.
    """
    return _step("open", fixture, None, init, flow)


def close(fixture: str, *, init: Condition = None, flow: object = None) -> PlanStep:
    """Return the step that closes a door or a drawer; arguments as for `open`."""
    return _step("close", fixture, None, init, flow)


def pick(item: str, *, init: Condition = None, flow: object = None) -> PlanStep:
    """Return the step that picks an item up from wherever it is; arguments as for `open`."""
    return _step("pick", item, None, init, flow)


def place(
    item: str,
    *,
    inside: str | None = None,
    ontop: str | None = None,
    init: Condition = None,
    flow: object = None,
) -> PlanStep:
    """Return the step that puts an item, which the hand holds, into one object or onto it.

    Args:
        item: Id of the item.
        inside: Id of what it is put into.
        ontop: Id of what it is put onto, instead.
        init: What must hold where the step begins; by default that the hand holds the item.
        flow: Actions, or their JSON form; by default the usual ones.

    Raises:
        TaskError: Neither `inside` nor `ontop` is given, or both are.
    """
    places = [Placement(name, to) for name, to in (("inside", inside), ("ontop", ontop)) if to is not None]
    if len(places) != 1:
        problem = f"expected one of inside and ontop, got {'both' if places else 'neither'}"
        hint = f'as in oag.place("{item}", inside="drawer_0")'
        raise TaskError(problem, source=_ARGUMENT, place="place", hint=hint)
    return _step("place", item, places[0], init, flow)


def _step(verb: Verb, target: str, placement: Placement | None, init: Condition, flow: object) -> PlanStep:
    for given in (target, *(() if placement is None else (placement.support,))):
        named: object = given
        if not isinstance(named, str):
            raise TaskError(f"expected the id of an object, got {shown(named)}", source=_ARGUMENT, place=verb)
    start = None if init is None else formula_of(init, "init")
    return PlanStep(verb, target, placement, start, None if flow is None else flow_of(flow))


def task(
    scene: Scene,
    *,
    steps: Iterable[PlanStep | SimpleTask | str] = (),
    goal: Condition = None,
    name: str = "task",
    detail: str = "",
    scales: Mapping[str, float] | None = None,
) -> Task:
    """Return the task of some steps in a scene, one simple task each; initial conditions are computed.

    Args:
        scene: The scene that the plan is for.
        steps: From `open`, `close`, `pick` and `place`; a `SimpleTask` is taken as it is. A text such as
            `"PUSH puck_0 cup_0"` is a primitive of the scene's domain with its objects.
        goal: The task goal, as a formula or its text; by default what the steps leave behind, which cannot show that
            a step is missing.
        name: For people and records.
        detail: What to do, in a sentence.
        scales: Id -> factor of the size adjustment.

    Raises:
        SceneError: A step names an object that the scene lacks.
        TaskError: The goal cannot be read, or a step is none.

    Example:
        >>> import oag
        >>> scene = oag.scene({"drawer_0": "drawer"}, closed="all")
        >>> oag.compose(oag.task(scene, steps=[oag.open("drawer_0")])).verify().verdict
        <Verdict.PROVED: 'PROVED'>
    """
    required_scene(scene)
    given = tuple(_own_step(one, scene) for one in steps)
    drafts = [_draft(index, one, scene) for index, one in enumerate(given)]
    state = start_state(scene, drafts[0].target if drafts else None)
    subtasks, time = [], START
    for one, draft, compiled in zip(given, drafts, compile_plan(drafts, scene), strict=True):
        written = _written(one, draft, state, scene) if isinstance(one, PlanStep) else draft
        subtasks.append(written)
        for action in written.flow or ():
            time += 1
            state = step(state, compiled.rows, action.primitive, action.parameter, time)[1]
        # A step that cannot work is reported by `verify`; those after it are written as if it had.
        time += 1
        state = assume_true(state, compiled.goal, time)
    wanted = default_goal(subtasks) if goal is None else formula_of(goal, "goal", scene.domain)
    return Task(name, detail, wanted, goal is not None, tuple(subtasks), dict(scales or {}), scene)


def _own_step(one: PlanStep | SimpleTask | str, scene: Scene) -> PlanStep | SimpleTask | str:
    return read_own_subtask(one, scene) or one if isinstance(one, str) else one


def _draft(index: int, one: object, scene: Scene) -> SimpleTask:
    """Return a step as a simple task, without what depends on where it begins."""
    if isinstance(one, SimpleTask):
        scene[one.target]
        return one
    if not isinstance(one, PlanStep):
        hint = 'such as oag.pick("apple_0")'
        raise TaskError(f"expected a step, got {shown(one)}", source=_ARGUMENT, place=f"steps[{index}]", hint=hint)
    scene[one.target]
    is_open = bddl.Atom("open", (one.target,))
    if one.placement is not None:
        scene[one.placement.support]
        relation, support = one.placement
        words = f"put {one.target} {'on' if relation == 'ontop' else relation} {support}"
        there = bddl.Atom(relation, (one.target, support))
        return _simple(words, one, there, (), support)
    if one.verb == "pick":
        return _simple(f"pick up {one.target}", one, bddl.Atom("inside", (one.target, GRIPPER)), ())
    wanted = is_open if one.verb == "open" else bddl.Not(is_open)
    return _simple(f"{one.verb} {one.target}", one, wanted, OPEN if one.verb == "open" else CLOSE)


def _simple(
    words: str, one: PlanStep, goal: bddl.Formula, flow: Iterable[Primitive], support_goal: str | None = None
) -> SimpleTask:
    actions = tuple(map(Action, flow)) if one.flow is None else one.flow
    sentence, init = f"{words[0].upper()}{words[1:]}.", _NOTHING if one.init is None else one.init
    return SimpleTask(words.replace(" ", "_"), sentence, one.target, None, support_goal, init, goal, actions)


def _written(one: PlanStep, draft: SimpleTask, state: State, scene: Scene) -> SimpleTask:
    """Return a step's simple task where it begins in a state: with the initial condition, supports and flow."""
    target, origin = one.target, None
    if one.verb in ("open", "close"):
        is_open = bddl.Atom("open", (target,))
        known = state.holds(is_open)
        init = _NOTHING if known is None else is_open if known else bddl.Not(is_open)
        usual = draft.flow
    elif one.verb == "pick":
        origin = _origin(target, state, scene)
        init = _NOTHING if origin is None else bddl.Atom(origin.relation, (target, origin.support))
        # Where it is is unknown, and the hand backs out of whatever that is.
        usual = _actions(
            taking("inside", "") if origin is None else taking(origin.relation, scene[origin.support].category)
        )
    else:
        init, usual = bddl.Atom("inside", (target, GRIPPER)), _actions(PLACE)
    return replace(
        draft,
        init=init if one.init is None else one.init,
        support_init=None if origin is None else origin.support,
        flow=usual if one.flow is None else one.flow,
    )


def _origin(item: str, state: State, scene: Scene) -> Placement | None:
    """Return what an item is known to be directly in or on; None when nothing is known."""
    places = [
        Placement(relation, key)
        for relation in RESTING
        for key in scene.objects
        if key != item and state.value((relation, item, key)) is True
    ]
    # What carries it stands in or on the others.
    inner = [p for p in places if scene[p.support].kind is Kind.ITEM] or places
    return next((p for p in inner if p.relation == "inside"), inner[0] if inner else None)


def _actions(primitives: Iterable[Primitive]) -> ActionFlow:
    return tuple(map(Action, primitives))
