"""All that is to be said of a plan that was followed, in the order in which reports list it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import bddl
from bddl.syntax.tree import Quantified
from oag.explain.explain import Explainer
from oag.flows.noflow import NoFlow, no_flow_finding, searched_notes
from oag.model.categories import Kind
from oag.model.diagnostic import SCALES, TASK_GOAL, Diagnostic
from oag.model.facts import Condition, Fact, Value, condition_of, fact_text, generalisations
from oag.model.primitives import Primitive
from oag.model.scene import Scene
from oag.progression.progress import Step, Trace
from oag.table.library import RESTING, needed
from oag.table.start import scene_facts
from oag.table.state import START, truth_of
from oag.task.goals import default_goal, there_to_change
from oag.task.sizes import resizings
from oag.task.task import Task, label, step_place, subtask_place


def all_findings(
    task: Task, scene: Scene, trace: Trace, proof: NoFlow | None, searched: tuple[int, ...]
) -> tuple[Diagnostic, ...]:
    """Returns the diagnostics of a well-formed plan: errors first, then warnings, then notes.

    `searched` are the indices of the subtasks whose flow was searched; `proof` shows that one has none.
    """
    explainer = Explainer(task, scene, trace)
    found = [*explainer.failures(), *explainer.assumptions(), *no_flow_finding(task, trace, proof)]
    if trace.unsettled is not None:
        message = f"this was not decided exactly ({trace.unsettled}): the plan may be better or worse than is said here"
        hint = "state more of the scene's facts, or say the conditions in fewer alternatives"
        found.append(_warning("context/undecided", message, "task", hint=hint))
    if not task.subtasks:
        message, hint = "there are no subtasks: the verdict is about doing nothing", 'list them under "sub_tasks"'
        found.append(_warning("task/empty", message, "task", hint=hint))
    runs = not trace.failures and proof is None
    for index in trace.vacuous if runs else ():
        message = f"its goal {bddl.format(task.subtasks[index].goal)} holds already when it starts"
        hint = "drop the subtask, or say what it has to change"
        found.append(_warning("task/vacuous", message, subtask_place(task, index), index, hint=hint))
    if runs and trace.undecided_from is None:
        found.extend(_holds_at_start(task, scene, trace))
    found.extend(locality_findings(task, scene, trace, runs=runs))
    if runs:
        found.extend(explainer.goal_gaps())
        found.extend(_omitted_effects(task, trace))
    found.extend(searched_notes(task, searched))
    found.extend(_unfilled(task))
    found.extend(Diagnostic("task/scaled", "note", str(change), SCALES) for change in resizings(task.scales, scene))
    return tuple(found)


def _holds_at_start(task: Task, scene: Scene, trace: Trace) -> Iterator[Diagnostic]:
    """Yield a warning where the task goal holds before anything moved: a rollout that does nothing fulfils it."""
    goal = needed(task.goal)
    if task.subtasks and goal != () and truth_of(goal, trace.start.value, scene.categories):
        message = (
            f"the task goal {bddl.format(task.goal)} holds at the start already: a robot that does nothing reaches it"
        )
        hint = "say in the goal what the subtasks have to change"
        yield _warning("goal/holds-at-start", message, TASK_GOAL, hint=hint)


def _omitted_effects(task: Task, trace: Trace) -> Iterator[Diagnostic]:
    """Yield a note for what subtasks are there to bring about, and bring about, and the task goal does not speak of.

    The goal speaks of an item where it says anything of its place, and of a door where it says how that shall be.
    """
    if not task.goal_given or trace.undecided_from is not None or trace.unsettled is not None:
        return
    spoken = {(atom.predicate in RESTING, atom.args[:1]) for atom in bddl.atoms(task.goal)}
    bound = {binder.variable for node in task.goal.walk() if isinstance(node, Quantified) for binder in node.binders}
    of_any = {is_place for is_place, args in spoken if bound.intersection(args)}
    effects = [
        literal
        for part in bddl.conjuncts(default_goal(task.subtasks))
        for literal in bddl.literals(part) or ()
        if trace.start.holds(literal.atom) is not literal.value
    ]
    placed = {atom.args[:1] for atom, wanted in effects if wanted and atom.predicate in RESTING}
    omitted = []
    for atom, wanted in effects:
        is_place = atom.predicate in RESTING
        # Where an item is put says more than where it was taken from.
        if not wanted and is_place and atom.args[:1] in placed:
            continue
        if is_place not in of_any and (is_place, atom.args[:1]) not in spoken:
            omitted.append(bddl.format(atom if wanted else bddl.Not(atom)))
    if omitted:
        holds = f"{', '.join(omitted)} {'holds' if len(omitted) == 1 else 'hold'}"
        message = f"{holds} at the end, as the subtasks want it, and the task goal says nothing of it"
        hint = "add to the goal what is wanted; a rollout that loses it counts as a success"
        yield Diagnostic("goal/omits-effect", "note", message, TASK_GOAL, hint=hint)


def _unfilled(task: Task) -> Iterator[Diagnostic]:
    steps = [
        f"{label(index, position)} {action.primitive.name}"
        for index, subtask in enumerate(task.subtasks)
        for position, action in enumerate(subtask.flow or ())
        if action.unfilled
    ]
    if steps:
        message = f"the executor's geometric planner fills in the numbers of {', '.join(steps)}"
        yield Diagnostic("flow/unfilled", "note", message, "task")


def locality_findings(task: Task, scene: Scene, trace: Trace, *, runs: bool) -> Iterator[Diagnostic]:
    """Yields warnings for what is changed beside what a subtask is about, and a note for cargo that is grasped along.

    A subtask may change what is about its target and support. What it undoes of another subtask's goal without being
    there to change it is clobbered; what it changes of the rest of the scene is outside its scope.

    Source: docs/codes/README.md, Locality; the paper asks a subtask to preserve the irrelevant parts of the scene.

    Args:
        runs: Whether the plan may go through; in one that does not, who undid what is said with what lacks it.
    """
    if runs:
        yield from _changes(task, scene, trace)
    yield from _cargo(task, scene, trace)


def _cargo(task: Task, scene: Scene, trace: Trace) -> Iterator[Diagnostic]:
    """Yields a note for each item that is grasped while something is known to rest on or in it."""
    state = trace.start
    # Support -> what was ever put on or in it, in order.
    put: dict[str, dict[Fact, None]] = {}
    for time, effect in ((START, scene_facts(scene)), *trace.writes):
        step = trace.steps[time // 2 - 1] if time > START and time % 2 == 0 else None
        item = None if step is None else task.subtasks[step.subtask].target
        if step is not None and item in put and step.primitive is Primitive.GRASP and scene[item].kind is Kind.ITEM:
            carried = ", ".join(fact_text(fact, True) for fact in put[item] if state.value(fact) is True)
            if carried:
                message = f"what is on or in {item} moves along: {carried}"
                place = step_place(task, step.subtask, step.position)
                yield Diagnostic("locality/cargo", "note", message, place, step.subtask, step.position)
        state = state.after(effect, time)
        for fact, value in effect:
            if value is True and len(fact) == 3 and fact[0] in RESTING:
                put.setdefault(fact[2], {})[fact] = None


class _Standing(NamedTuple):
    """A literal that holds: the index of the subtask whose goal it is, None for a fact of the scene."""

    condition: Condition
    owner: int | None


class _Ground:
    """What holds so far of goals and of the scene's facts, found by any pattern that covers it."""

    def __init__(self) -> None:
        self._standing: dict[Fact, _Standing] = {}
        self._covered: dict[Fact, dict[Fact, None]] = {}

    def put(self, condition: Condition, owner: int | None) -> None:
        """Adds a literal; the last subtask whose goal it is answers for it."""
        fact = condition.fact
        if fact not in self._standing:
            for pattern in generalisations(fact):
                self._covered.setdefault(pattern, {})[fact] = None
        self._standing[fact] = _Standing(condition, owner)

    def undone(self, step: Step) -> Iterator[tuple[_Standing, Value]]:
        """Takes away what a step makes false or unknown, and yields it with the value that it has then."""
        told = {fact for fact, _ in step.effect}
        for pattern, value in step.effect:
            for fact in tuple(self._covered.get(pattern, ())):
                standing = self._standing[fact]
                if (fact == pattern or fact not in told) and standing.condition.grade(value) is not True:
                    for covering in generalisations(fact):
                        del self._covered[covering][fact]
                    del self._standing[fact]
                    yield standing, value


def _changes(task: Task, scene: Scene, trace: Trace) -> Iterator[Diagnostic]:
    """Yields what steps undo that is none of their subtask's business, in the order of the plan."""
    ground, ended = _Ground(), 0
    for fact, value in scene_facts(scene):
        if value is True:
            ground.put(Condition(fact, True), None)
    for step in trace.steps:
        for index in range(ended, step.subtask):
            for atom, wanted in bddl.literals(task.subtasks[index].goal) or ():
                ground.put(condition_of(atom, wanted), index)
        ended = step.subtask
        for standing, value in ground.undone(step):
            yield from _judge(task, step, standing, value)


def _judge(task: Task, step: Step, standing: _Standing, value: Value) -> Iterator[Diagnostic]:
    """Yields a warning for something that a step undoes, unless its subtask is there to do that."""
    (condition, owner), subtask = standing, task.subtasks[step.subtask]
    at = (step_place(task, step.subtask, step.position), step.subtask, step.position)
    said = f"undoes {condition.text()}" if value is not None else f"leaves open whether {condition.text()}"
    while_about = f"while the subtask is about {subtask.target}"
    if owner is None:
        if subtask.target not in condition.fact:
            yield _warning("locality/outside-scope", f"{said}, {while_about}", *at)
        return
    literal = condition.literal()
    if literal is not None and not there_to_change(subtask, literal):
        goal_of, number = f"T{owner + 1} {task.subtasks[owner].name}", f"T{step.subtask + 1}"
        hint = f"do {number} before {goal_of}, or say in {number}'s goal that this is to change"
        yield _warning("locality/clobbers", f"{said}, the goal of {goal_of}, {while_about}", *at, hint)


def _warning(
    code: str, message: str, place: str, subtask: int | None = None, step: int | None = None, hint: str | None = None
) -> Diagnostic:
    return Diagnostic(code, "warning", message, place, subtask, step, hint=hint)
