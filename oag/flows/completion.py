"""Subtasks without a flow get one by search, chosen so that the rest of the plan can still go through.

Source: docs/semantics.md, Flows that are searched; the paper's primitive completeness assumes that a flow exists.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import bddl
from oag.flows.search import (
    Found,
    Leave,
    PrimitiveFlow,
    TooManyStates,
    flows,
    legal_primitives,
    run_through,
    run_whatever,
)
from oag.model.actions import Action
from oag.model.facts import GRIPPER
from oag.model.scene import Scene
from oag.progression.compiled import compile_plan, facts_read
from oag.table.library import Needed, needed, placement_of
from oag.table.start import contradictions
from oag.table.state import View, Window, granted, start_state
from oag.task.task import SimpleTask, Task, chosen_scene
from oag.task.wellformed import check

# How many partial plans a search over all missing flows may look at.
MOST_OPTIONS = 5_000


@dataclass(frozen=True, slots=True)
class Completion:
    """A task with the flows that a search could add.

    Attributes:
        task: The task; every subtask that got a flow has it.
        searched: Indices of the subtasks whose flow was searched and found.
        missing: Indices of the subtasks that still have none.
    """

    task: Task
    searched: tuple[int, ...]
    missing: tuple[int, ...]


def complete(task: Task, scene: Scene | None = None) -> Completion:
    """Returns a task with a flow for every subtask that lacks one and can have one.

    Flows are chosen so that the whole plan goes through where that is possible at all; else so that each subtask
    reaches its goal and, if it can, the initial condition of the next one. The first subtask for which no flow exists
    ends the search: what comes after it has no start to search from. Given flows are never changed. A goal that leaves
    a choice, such as a disjunction, is narrowed to one way to meet it where only that has a flow.

    Args:
        task: The plan. One that is not well formed is returned as it is.
        scene: Where it starts; by default the scene that the task carries.

    Raises:
        MissingScene: There is no scene, neither here nor with the task.
        TaskError, SceneError: An argument is no `Task`, or no `Scene`.

    Example:
        >>> import oag
        >>> scene = oag.Scene.from_json({"objects": {"box_0": {"category": "drawer", "bbox_extent": [1, 1, 1]}}})
        >>> opening = {"target": "box_0", "init": "(not (open box_0))", "goal": "(open box_0)"}
        >>> task = oag.Task.from_json({"sub_tasks": [opening]}, scene=scene)
        >>> [action.primitive.name for action in oag.complete(task).task.subtasks[0].flow][:3]
        ['NAVIGATE_TO_TARGET', 'APPROACH', 'CONVERGE']
    """
    return _completed(task, chosen_scene(task, scene), iter(range(MOST_WAYS)))[0]


def _completed(task: Task, scene: Scene, tries: Iterator[int]) -> tuple[Completion, bool]:
    """Returns a task with the flows that it lacks, and whether the whole plan goes through with them.

    Args:
        tries: One for each way to meet a goal that may be tried.
    """
    lacking = tuple(index for index, subtask in enumerate(task.subtasks) if subtask.flow is None)
    if not lacking or check(task, scene):
        return Completion(task, (), lacking), not lacking
    chain = _Chain(task, scene)
    through = next(filter(None, (chain.through(leave) for leave in Leave)), None)
    found = through or chain.as_far_as_possible()
    subtasks = list(task.subtasks)
    for index in lacking:
        if index < len(found):
            subtasks[index] = replace(subtasks[index], flow=tuple(map(Action, found[index])))
    done = tuple(index for index in lacking if index < len(found))
    completion = Completion(replace(task, subtasks=tuple(subtasks)), done, lacking[len(done) :])
    if through is not None or not completion.missing:
        return completion, through is not None
    return _with_a_choice(task, scene, completion, tries)


def _with_a_choice(task: Task, scene: Scene, completion: Completion, tries: Iterator[int]) -> tuple[Completion, bool]:
    """Returns the completion in which the first subtask that got no flow has one for a way to meet its goal.

    The first way is taken with which the whole plan goes through; if there is none, the first that gets furthest.
    """
    first, furthest = completion.missing[0], completion
    for option, _ in zip(narrowed(task.subtasks[first], scene), tries, strict=False):
        chosen = replace(task, subtasks=(*task.subtasks[:first], option, *task.subtasks[first + 1 :]))
        found, through = _completed(chosen, scene, tries)
        if through:
            return found, True
        if furthest.missing and (not found.missing or found.missing[0] > furthest.missing[0]):
            furthest = found
    return furthest, False


class _Chain:
    """A task's subtasks as one search: given flows are followed, missing ones are tried."""

    def __init__(self, task: Task, scene: Scene) -> None:
        objects = scene.categories
        self.subtasks = compile_plan(task.subtasks, scene)
        self.goal: Needed = needed(task.goal)
        window = Window(facts_read(self.subtasks, self.goal, objects), objects)
        self.start: View = window.view(start_state(scene, task.subtasks[0].target))
        self.legal = tuple(
            legal_primitives(scene.objects[subtask.target].kind, subtask.support_goal) for subtask in task.subtasks
        )

    def through(self, leave: Leave) -> list[PrimitiveFlow]:
        """Returns flows with which the whole plan goes through and which leave no more open; none when there are none.

        Depth first over the subtasks, each one's flows in the order of `flows`; from a state that failed once at a
        subtask, nothing is tried again.
        """
        failed: set[tuple[int, View]] = set()
        chosen: list[Found] = []
        open_options: list[Iterator[Found]] = [self._options(0, self.start, leave)]
        for _ in range(MOST_OPTIONS):
            if not open_options:
                return []
            index = len(open_options) - 1
            try:
                option = next(open_options[-1], None)
            except TooManyStates:
                option = None
            if option is None:
                open_options.pop()
                before = chosen[-1].state if chosen else self.start
                failed.add((index, before))
                del chosen[index - 1 if index else 0 :]
                continue
            if index + 1 == len(self.subtasks):
                if self._may(option.state.truth(self.goal), leave):
                    return [found.flow for found in (*chosen, option)]
                continue
            if (index + 1, option.state) not in failed:
                chosen.append(option)
                open_options.append(self._options(index + 1, option.state, leave))
        return []

    def as_far_as_possible(self) -> list[PrimitiveFlow]:
        """Returns flows up to the first subtask that can have none, whatever fails on the way."""
        chosen: list[PrimitiveFlow] = []
        state = self.start
        for index, subtask in enumerate(self.subtasks):
            state = granted(state, subtask.init)
            if subtask.flow is None:
                found = self._best(index, state)
                if found is None:
                    return chosen
            else:
                found = Found(tuple(action.primitive for action in subtask.flow), run_whatever(state, subtask))
            chosen.append(found.flow)
            state = granted(found.state, subtask.goal)
        return chosen

    def _options(self, index: int, state: View, leave: Leave) -> Iterator[Found]:
        """Yields the flows of one subtask from a state, the given one alone where there is one."""
        subtask = self.subtasks[index]
        if state.truth(subtask.init) is False:
            return
        state = granted(state, subtask.init)
        if subtask.flow is None:
            yield from flows(state, subtask, self.legal[index], leave)
            return
        end = run_through(state, subtask)
        if end is not None and end.truth(subtask.goal) is not False:
            yield Found(tuple(action.primitive for action in subtask.flow), end)

    def _best(self, index: int, state: View) -> Found | None:
        """Returns the first flow that also lets the next subtask start, else the first flow."""
        following = self.subtasks[index + 1].init if index + 1 < len(self.subtasks) else self.goal
        first: Found | None = None
        for leave in Leave:
            try:
                for found in flows(state, self.subtasks[index], self.legal[index], leave):
                    first = first or found
                    if self._may(found.state.truth(following), leave):
                        return found
            except TooManyStates:
                pass
        return first

    @staticmethod
    def _may(truth: bool | None, leave: Leave) -> bool:
        """Decides whether what comes after may be left as it is: a goal is open only where that is allowed."""
        return truth is True or (truth is None and leave is Leave.GOALS)


# So many ways to meet goals are tried in one task; there may be more, and then nothing is claimed of them.
MOST_WAYS = 64


def narrowed(subtask: SimpleTask, scene: Scene) -> Iterator[SimpleTask]:
    """Yields a subtask with one way to meet its goal for its goal, those that change least of the start first.

    Args:
        subtask: One whose goal is no conjunction of literals; of any other there is nothing to choose.
        scene: Where the plan starts.

    Yields:
        Each goal makes the one given true, whatever else is the case. A goal support that was
        given is kept; where none was, it is where the way puts the target.
    """
    if bddl.literals(subtask.goal) is not None:
        return
    known = start_state(scene, None)
    # What the hand holds is no matter of the start.
    atoms = (atom for atom in bddl.ground(subtask.goal, scene.categories).atoms if GRIPPER not in atom.args)
    state = {atom: value for atom in atoms if (value := known.holds(atom)) is not None}
    try:
        for way in bddl.options(subtask.goal, scene.categories, state):
            goal = bddl.And(tuple(literal.formula for literal in way))
            placement = placement_of(goal, subtask.target)
            support = subtask.support_goal if placement is None else placement.support
            if contradictions(way) is None and subtask.support_goal in (None, support):
                yield replace(subtask, goal=goal.parts[0] if len(goal.parts) == 1 else goal, support_goal=support)
    except bddl.SearchLimit:
        return
