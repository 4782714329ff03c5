"""Simple tasks and tasks: what a planner proposes.

Mistakes in a file's formulas and flows are kept as diagnostics of the task; in memory they are errors.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, NamedTuple, Self

import bddl
from bddl.ast import Quantified
from bddl.terminal import pluralize
from oag.model.actions import ActionFlow, flow_to_json
from oag.model.codec import Document, ReadBy, Source, brief, load, missing, number, shown
from oag.model.diagnostics import TASK_GOAL, Diagnostic, MissingScene, SceneError, TaskError
from oag.model.domain import BUILT_IN, Domain
from oag.model.reading import flow_of, formula_of, read_flow, read_formula, where_of
from oag.model.scene import SCALES, Scene
from oag.model.symbols import ANY, GRIPPER, Fact, Primitive, overlap
from oag.model.where import Where
from oag.primitives.cargo import RESTING
from oag.primitives.table import carries, placement_of


@dataclass(frozen=True, slots=True)
class TaskForm:
    """Form of a task's file; the subtasks may also be under `sub_task_1`, `sub_task_2`, ..."""

    sub_tasks: list[object] | None = None
    task_activity_name: str | None = None
    task_detail_message: str | None = None
    task_message_detail: str | None = None
    goal: str | None = None
    scales: dict[str, Annotated[float, ReadBy(partial(number, low=SCALES[0], high=SCALES[1]))]] | None = None


@dataclass(frozen=True, slots=True)
class SubtaskForm:
    """Form of a subtask in a task's file; its texts and its flow are judged later."""

    init: str
    goal: str
    task_activity_name: str | None = None
    task_detail_message: str | None = None
    task_message_detail: str | None = None
    target: str | None = None
    support_init: str | None = None
    support_goal: str | None = None
    flow: list[object] | None = None
    where: str | None = None


def subtask_places(document: Document, form: TaskForm) -> list[tuple[str | int, ...]]:
    """Return the paths of the subtasks in order: in the list `sub_tasks`, or at `sub_task_1`, `sub_task_2`, ...

    Raises an InputError when there are neither, or both, of which one would be lost.
    """
    matches = (re.fullmatch(r"sub_task_(\d{1,9})", key) for key in document.at())
    numbered = [(int(match[1]), match[0]) for match in matches if match is not None]
    if form.sub_tasks is None and not numbered:
        raise document.fail((), *missing("sub_tasks", document.at()))
    if form.sub_tasks is None:
        return [(key,) for _, key in sorted(numbered, key=lambda pair: pair[0])]
    if numbered:
        problem = f"the subtasks are listed here, and {numbered[0][1]} stands beside the list"
        hint = "write all of them under sub_tasks, or each under sub_task_1, sub_task_2, ..."
        raise document.fail(("sub_tasks",), problem, hint)
    return [("sub_tasks", index) for index in range(len(form.sub_tasks))]


# Stands for a target that could not be inferred; the task then carries the reason as an issue.
NO_TARGET = ""


class Roles(NamedTuple):
    """The three objects of a simple task; `problem` says why the target is unknown, and is empty if it is known."""

    target: str
    support_init: str | None
    support_goal: str | None
    problem: str = ""


def infer_roles(init: bddl.Formula, goal: bddl.Formula, target: str | None = None) -> Roles:
    """Return the roles that an initial state and a goal imply.

    Unless it is given, the target is the first argument of the goal's literals beyond the initial state, if that is one
    object. Otherwise `target` is empty and `problem` gives the reason.

    Example:
        >>> import bddl
        >>> infer_roles(bddl.parse_formula("(ontop cup_0 table_0)"), bddl.parse_formula("(not (ontop cup_0 table_0))"))
        Roles(target='cup_0', support_init='table_0', support_goal=None, problem='')
    """
    if target is None:
        subjects = _subjects(init, goal)
        if len(subjects) != 1:
            return Roles(NO_TARGET, None, None, _ambiguous(subjects))
        target = subjects[0]
    placement = placement_of(goal, target)
    return Roles(target, _support_before(init, goal, target), None if placement is None else placement.support)


def _subjects(init: bddl.Formula, goal: bddl.Formula) -> tuple[str, ...]:
    """Return the first arguments of the goal's new literals; if there are none, of all its literals."""
    literals = bddl.literals(goal)
    if literals is None:
        ordered = sorted(bddl.atoms(goal), key=str)
        return tuple(dict.fromkeys(atom.args[0] for atom in ordered if atom.args and not atom.args[0].startswith("?")))
    before = {(literal.atom, literal.value) for literal in bddl.literals(init) or ()}
    spoken = dict.fromkeys(literal.atom.args[0] for literal in literals if literal.atom.args)
    fresh = [literal for literal in literals if (literal.atom, literal.value) not in before]
    return tuple(dict.fromkeys(literal.atom.args[0] for literal in fresh if literal.atom.args)) or tuple(spoken)


def _ambiguous(subjects: tuple[str, ...]) -> str:
    if not subjects:
        return "the goal speaks of no object, so it cannot be told what the subtask is about"
    named = f"{', '.join(subjects[:-1])} and {subjects[-1]}"
    return f"the goal changes {named}, so it cannot be told which of them the subtask is about"


def _support_before(init: bddl.Formula, goal: bddl.Formula, target: str) -> str | None:
    """Return what the target rests on or in at first, from the initial state, or from what the goal takes away."""
    for formula, value in ((init, True), (goal, False)):
        for literal in bddl.literals(formula) or ():
            atom = literal.atom
            rests = atom.predicate in RESTING and len(atom.args) == 2 and atom.args[1] != GRIPPER
            if rests and atom.args[0] == target and literal.value is value:
                return atom.args[1]
    return None


@dataclass(frozen=True, slots=True)
class SimpleTask:
    """One subtask: the roles of its objects, where it starts, where it ends, and how.

    Attributes:
        name: Its activity, such as `open_refrigerator`.
        detail: What to do, for people and models.
        target: Id of the object it acts on (o_t).
        support_init: Id of the object that the initial state relates the target to (o_s1), or None.
        support_goal: Id of the object that the goal relates the target to (o_s2), or None.
        init: What must hold when it starts; its text is accepted and read.
        goal: What must hold when it ends, likewise.
        flow: Its actions; None when none is planned yet. A list in the JSON form is accepted and read.
        issues: Mistakes found while it was read, such as an unbalanced parenthesis; `verify` reports them. Their place
            is within the subtask ("init", "step 3"), whichever place the subtask has in a task.
        where: The part or the spot that is meant, which no condition tells apart; geometry and detectors hold to it.
            Its text is accepted and read.

    Source: the paper's Definition of a simple task, T = <o_t, o_s1, o_s2, s_init, s_goal>.
    """

    name: str
    detail: str
    target: str
    support_init: str | None
    support_goal: str | None
    init: bddl.Formula
    goal: bddl.Formula
    flow: ActionFlow | None = None
    issues: tuple[Diagnostic, ...] = ()
    where: Where | None = None

    def __post_init__(self) -> None:
        """Read what is given as a text or in the JSON form; raises TaskError or FlowError for anything else."""
        for role in ("target", "support_init", "support_goal"):
            name: object = getattr(self, role)
            if not isinstance(name, str) and (name is not None or role == "target"):
                raise TaskError(f"expected the id of an object, got {shown(name)}", source="(argument)", place=role)
        for field_name in ("init", "goal"):
            object.__setattr__(self, field_name, formula_of(getattr(self, field_name), field_name))
        if self.flow is not None:
            object.__setattr__(self, "flow", flow_of(self.flow))
        where: object = self.where
        if where is not None and not isinstance(where, Where):
            object.__setattr__(self, "where", where_of(where))

    def __repr__(self) -> str:
        steps = "no flow" if self.flow is None else pluralize(len(self.flow), "step")
        text = (
            f"<SimpleTask {self.name!r}: {self.target}, {bddl.format(self.init)} to {bddl.format(self.goal)}, {steps}>"
        )
        return brief(text)

    @property
    def roles(self) -> tuple[str, str | None, str | None]:
        """The target, and the supports of the initial state and of the goal."""
        return self.target, self.support_init, self.support_goal

    def to_json(self) -> dict[str, object]:
        """Return the subtask as task files have it."""
        written: dict[str, object] = {
            "task_activity_name": self.name,
            "task_detail_message": self.detail,
            "target": self.target,
            "support_init": self.support_init,
            "support_goal": self.support_goal,
            "init": bddl.format(self.init),
            "goal": bddl.format(self.goal),
        }
        if self.flow is not None:
            written["flow"] = flow_to_json(self.flow)
        if self.where is not None:
            written["where"] = str(self.where)
        return written


@dataclass(frozen=True, slots=True)
class Task:
    """An ordered sequence of subtasks with the goal that the query asks for.

    Attributes:
        detail: What to do, for people and models.
        goal: The task goal G, judged after the last subtask.
        goal_given: True when G was given apart from the decomposition; False when it was derived from the subtasks,
            which cannot detect a dropped subtask.
        scales: Object id -> factor of the size adjustment.
        scene: The scene it was planned for, if known.
        issues: Mistakes found while it was read that belong to no subtask.
        source: The JSON it was read from when that has mistakes which the fields above cannot hold.

    Source: the paper's Definition of a complex long-horizon task; G is a departure (docs/semantics.md).
    """

    name: str
    detail: str
    goal: bddl.Formula
    goal_given: bool
    subtasks: tuple[SimpleTask, ...]
    scales: Mapping[str, float] = field(default_factory=dict)
    scene: Scene | None = None
    issues: tuple[Diagnostic, ...] = ()
    source: Mapping[str, object] | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Read a goal that is given as a text; raises TaskError for no formula and for no `SimpleTask`."""
        object.__setattr__(self, "goal", formula_of(self.goal, "goal"))
        object.__setattr__(self, "subtasks", tuple(self.subtasks))
        listed: tuple[object, ...] = self.subtasks
        for index, subtask in enumerate(listed):
            if not isinstance(subtask, SimpleTask):
                place = f"subtasks[{index}]"
                raise TaskError(f"expected a SimpleTask, got {shown(subtask)}", source="(argument)", place=place)

    def __repr__(self) -> str:
        counted = pluralize(len(self.subtasks), "subtask")
        return brief(f"<Task {shown(self.name)}: {counted}, goal {bddl.format(self.goal)}>")

    @classmethod
    def from_json(cls, source: Source, scene: Scene | None = None) -> Self:
        """Return the task that a JSON file, or a mapping of the same form, describes.

        Args:
            source: Path or mapping; subtasks under `sub_tasks` (a list) or `sub_task_1`, `sub_task_2`, ...
            scene: The scene it is for; formulas and flows are read in its domain.

        Raises:
            TaskError: Malformed JSON, a missing field or a wrong type. Mistakes of the plan itself (an unknown
                object or primitive, a wrong arity, an unbalanced parenthesis) are kept and reported by `verify`.
        """
        document = load(source, TaskError)
        form = document.read(TaskForm)
        places = subtask_places(document, form)
        domain = scene.domain if isinstance(scene, Scene) else BUILT_IN
        subtasks = tuple(_read_subtask(index, document, place, domain) for index, place in enumerate(places))
        issues: tuple[Diagnostic, ...] = ()
        if form.goal is None:
            goal = default_goal(subtasks)
        else:
            goal, issues = read_formula(form.goal, TASK_GOAL, domain)
        broken = bool(issues) or any(subtask.issues for subtask in subtasks)
        return cls(
            name="task" if form.task_activity_name is None else form.task_activity_name,
            detail=form.task_detail_message or form.task_message_detail or "",
            goal=goal,
            goal_given=form.goal is not None,
            subtasks=subtasks,
            scales=form.scales or {},
            scene=scene,
            issues=issues,
            source=document.at() if broken else None,
        )

    def to_json(self) -> dict[str, object]:
        """Return the mapping that `from_json` reads back into an equal task (its scene is not part of it).

        A goal that was derived from other subtasks is written out, and counts as given when it is read again.
        """
        if self.source is not None:
            return dict(self.source)
        written: dict[str, object] = {"task_activity_name": self.name, "task_detail_message": self.detail}
        if self.goal_given or set(bddl.conjuncts(self.goal)) != set(bddl.conjuncts(default_goal(self.subtasks))):
            written["goal"] = bddl.format(self.goal)
        if self.scales:
            written["scales"] = dict(self.scales)
        written["sub_tasks"] = [subtask.to_json() for subtask in self.subtasks]
        return written


def _read_subtask(index: int, document: Document, place: Sequence[str | int], domain: Domain) -> SimpleTask:
    form = document.read(SubtaskForm, *place)
    given = document.at(*place)
    init, init_issues = read_formula(form.init, "init", domain)
    goal, goal_issues = read_formula(form.goal, "goal", domain)
    flow, flow_issues = read_flow(form.flow, domain)
    roles = infer_roles(init, goal, form.target)
    role_issues = () if init_issues or goal_issues else _role_issue(roles)
    try:
        where = None if form.where is None else Where.parse(form.where)
    except ValueError as problem:
        raise document.fail((*place, "where"), f"cannot be read: {shown(form.where)}", str(problem)) from None
    return SimpleTask(
        name=f"subtask_{index + 1}" if form.task_activity_name is None else form.task_activity_name,
        # The paper's outputs call it task_detail_message, its text task_message_detail.
        detail=form.task_detail_message or form.task_message_detail or "",
        target=roles.target,
        # A written role counts, null included.
        support_init=form.support_init if "support_init" in given else roles.support_init,
        support_goal=form.support_goal if "support_goal" in given else roles.support_goal,
        init=init,
        goal=goal,
        flow=flow,
        issues=(*init_issues, *goal_issues, *role_issues, *flow_issues),
        where=where,
    )


def _role_issue(roles: Roles) -> tuple[Diagnostic, ...]:
    if not roles.problem:
        return ()
    hint = "name it under target, or split the subtask so that each part changes one object"
    return (Diagnostic("task/role-scope", "error", roles.problem, hint=hint),)


_ARGUMENT, _READ = "(argument)", "oag.{}.from_json reads one from a file's path or a mapping"


def chosen_scene(task: Task, scene: Scene | None) -> Scene:
    """Return the scene to judge a task in: the one given, else the one that the task carries.

    Raises MissingScene when there is none, and TaskError or SceneError for an argument of another kind.
    """
    if not isinstance(task, Task):
        raise TaskError(f"expected a Task, got {shown(task)}", source=_ARGUMENT, hint=_READ.format("Task"))
    chosen = scene if scene is not None else task.scene
    if chosen is None:
        raise MissingScene(task.name)
    return required_scene(chosen)


def required_scene(scene: object) -> Scene:
    """Return a scene; raises SceneError for anything else, such as the name of one."""
    if not isinstance(scene, Scene):
        raise SceneError(f"expected a Scene, got {shown(scene)}", source=_ARGUMENT, hint=_READ.format("Scene"))
    return scene


def label(subtask: int, step: int) -> str:
    """Return the short name of a step, such as `T3.4`; both indices count from 0."""
    return f"T{subtask + 1}.{step + 1}"


def subtask_place(task: Task, subtask: int) -> str:
    """Return the name of a subtask with its number."""
    return f"T{subtask + 1} {task.subtasks[subtask].name}"


def step_place(task: Task, subtask: int, step: int) -> str:
    """Return the full name of a step."""
    flow = task.subtasks[subtask].flow or ()
    return f"{subtask_place(task, subtask)}, step {step + 1} {flow[step].primitive.name}"


def default_goal(subtasks: Sequence[SimpleTask]) -> bddl.Formula:
    """Return the conjunction of the subtask goals, without what later subtasks replace.

    A later subtask replaces what its own goal denies. It replaces the place of its target, the gripper included, when
    its flow or its goal takes the target away. A formula beyond literals is dropped as a whole when a later subtask
    replaces any of its atoms.

    Such a goal cannot detect a dropped subtask, so a report says when it was used.

    Example:
        >>> import oag
        >>> opened = {"target": "box_0", "init": "(and)", "goal": "(open box_0)"}
        >>> task = oag.Task.from_json({"sub_tasks": [opened, {**opened, "goal": "(not (open box_0))"}]})
        >>> str(default_goal(task.subtasks))
        '(not (open box_0))'

    Source: docs/semantics.md, Verdicts.
    """
    later: list[_GoalChange] = []
    literals: dict[bddl.Atom, bddl.Formula] = {}
    others: dict[bddl.Formula, None] = {}
    for subtask in reversed(subtasks):
        for part in reversed(bddl.conjuncts(subtask.goal)):
            if any(_replaced(demand, later) for demand in _demands(part, strictly=True)):
                continue
            literal = bddl.literals(part)
            if literal is None:
                others.setdefault(part)
            else:
                for atom, value in literal:
                    literals.setdefault(atom, atom if value else bddl.Not(atom))
        later.append(_goal_change(subtask))
    parts = (*reversed(literals.values()), *reversed(others))
    return parts[0] if len(parts) == 1 else bddl.And(parts)


def is_meant_to_change(subtask: SimpleTask, literal: bddl.Formula) -> bool:
    """Decide whether a subtask replaces a literal that held before it, as for the task goal."""
    change = _goal_change(subtask)
    return any(_replaced(demand, [change]) for demand in _demands(literal, strictly=True))


class _Demand(NamedTuple):
    """An atom of a formula; `*` stands for a variable, and `wanted` is False under a negation."""

    fact: Fact
    wanted: bool


class _GoalChange(NamedTuple):
    """Changes that a subtask is meant to make: by its goal, and by what it does with its target."""

    target: str
    demand: frozenset[_Demand]
    takes: bool
    releases: bool
    carries: bool


def _goal_change(subtask: SimpleTask) -> _GoalChange:
    demand = frozenset(_demands(subtask.goal, strictly=False))
    placed = placement_of(subtask.goal, subtask.target) is not None
    about = [part for part in demand if _is_place(part.fact) and part.fact[1] == subtask.target]
    picked = any(part.wanted is (part.fact[2:] == (GRIPPER,)) for part in about)
    flow = subtask.flow or ()
    steps = [action.primitive for action in flow]
    if Primitive.ARTICULATE_OPEN in steps or Primitive.ARTICULATE_CLOSE in steps:
        steps = []
    grasps, releases = Primitive.GRASP in steps, Primitive.UNGRASP in steps
    first = steps.index(Primitive.GRASP) if grasps else 0
    # What moves after the hand let go takes nothing along.
    last = max((i for i, step in enumerate(steps) if step is Primitive.UNGRASP and i > first), default=len(steps))
    held = flow[first:last] if grasps or releases else ()
    return _GoalChange(
        subtask.target,
        demand,
        takes=(picked or grasps) and not (placed or releases),
        releases=placed or releases,
        carries=placed or picked or any(carries(action.primitive, action.parameter) for action in held),
    )


def _replaced(demand: _Demand, later: Sequence[_GoalChange]) -> bool:
    """Decide whether an atom of an earlier goal is no longer meant to hold after some subtasks."""
    if _is_place(demand.fact) and _moved(demand, later):
        return True
    return any(
        other.wanted is not demand.wanted and _meets(demand.fact, other.fact, change.target)
        for change in later
        for other in change.demand
    )


def _moved(demand: _Demand, later: Sequence[_GoalChange]) -> bool:
    """Decide whether subtasks move the item of an earlier goal, and do not all put it there again."""
    _, item, place = demand.fact
    about = [change for change in later if item in (change.target, ANY)]
    if place == GRIPPER:
        return any(change.releases if demand.wanted else change.takes for change in about)
    away = [change for change in about if change.carries]
    return demand.wanted and len(away) > sum(demand in change.demand for change in away)


def _is_place(fact: Fact) -> bool:
    # Goals are read before it is checked that they are well formed.
    return fact[0] in RESTING and len(fact) == 3


def _meets(fact: Fact, other: Fact, target: str) -> bool:
    """Decide whether two facts are one, or with variables, can be one fact about a target."""
    if fact == other and ANY not in fact:
        return True
    if not overlap(fact, other):
        return False
    names = {b if a == ANY else a for a, b in zip(fact[1:], other[1:], strict=True)}
    return ANY in (*fact, *other) and (target in names or ANY in names)


def _demands(formula: bddl.Formula, *, strictly: bool) -> Iterator[_Demand]:
    """Yield the atoms of a formula, each with its wanted value.

    Strictly, atoms of exact counts come with both values, since more and fewer of them break the formula.
    """
    pending: list[tuple[bddl.Formula, tuple[bool, ...], frozenset[str]]] = [(formula, (True,), frozenset())]
    while pending:
        node, wanted, bound = pending.pop()
        if isinstance(node, bddl.Atom):
            fact = (node.predicate, *(ANY if name in bound else name for name in node.args))
            yield from (_Demand(fact, value) for value in wanted)
            continue
        opposite = tuple(not value for value in wanted)
        if isinstance(node, bddl.Not):
            wanted = opposite
        elif isinstance(node, Quantified):
            bound |= {binder.variable for binder in node.binders}
            if isinstance(node, bddl.ForN):
                wanted = opposite if node.count == 0 else (True, False) if strictly else wanted
        parts = [(operand, wanted) for operand in node.operands]
        if isinstance(node, bddl.Imply):
            parts[0] = (parts[0][0], opposite)
        pending.extend((operand, value, bound) for operand, value in reversed(parts))
