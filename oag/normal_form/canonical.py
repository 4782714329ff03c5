"""The canonical form of a task: one form for all the ways in which one decomposition can be written down.

    oag.canonical(task) == oag.canonical(reworded)

Source: docs/canonical.md; the paper's repeated decomposition study, which this makes a statement about formulas.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import bddl
from oag.certificate.certificate import digest
from oag.model.facts import GRIPPER, held_by
from oag.model.scene import Scene
from oag.normal_form.formulas import conjunction, tidy, tidy_goal
from oag.normal_form.names import resolver, with_scene_names
from oag.normal_form.order import content, ordered
from oag.normal_form.rewrite import Rewrite
from oag.normal_form.rules import changes
from oag.normal_form.survey import Place, survey, unknown_at_end
from oag.task.goals import default_goal
from oag.task.task import SimpleTask, Task, chosen_scene
from oag.task.wellformed import check

Choose = Callable[[Sequence[Rewrite]], Rewrite]


def canonical(task: Task, scene: Scene | None = None) -> Task:
    """Returns the canonical form of a task.

    Names are resolved to the scene's ids and formulas sorted; subtasks that change nothing are dropped, movements that
    were cut apart are joined, transports cut into picking up and putting down, and independent parts are put in one
    order. A missing step is never added, and of a plan that is not well formed only names and formulas are touched.

    Args:
        task: The task.
        scene: The scene it is for; by default the one that the task carries.

    Returns:
        A task with the same verdict, unless a superfluous subtask would have failed: then the form is the plan without
        it. The canonical form of a canonical form is itself.

    Raises:
        MissingScene: There is no scene, neither here nor with the task.
        TaskError, SceneError: An argument is no `Task`, or no `Scene`.

    Source: docs/canonical.md, Rules and Order.
    """
    chosen = chosen_scene(task, scene)
    named = prepared(task, chosen)
    if check(named, chosen):
        return named
    subtasks, _ = normalised(named.subtasks, chosen)
    places = survey(subtasks, chosen)
    return replace(
        named,
        subtasks=tuple(_renamed(place) for place in places),
        goal=named.goal if named.goal_given else _goal_of(places, named.goal, chosen),
    )


def canonical_digest(task: Task, scene: Scene | None = None, *, flows: bool = True) -> str:
    """Returns the SHA-256 of a task's canonical form: its goal and its subtasks, without names and descriptions.

    Args:
        task: The task.
        scene: The scene it is for; by default the one that the task carries.
        flows: False to compare decompositions alone, the five-tuples of the subtasks without their flows.

    Raises:
        MissingScene: There is no scene, neither here nor with the task.
        TaskError, SceneError: An argument is no `Task`, or no `Scene`.
    """
    form = canonical(task, scene)
    rows = [content(subtask) for subtask in form.subtasks]
    if not flows:
        rows = [{key: value for key, value in row.items() if key != "flow"} for row in rows]
    scales = dict(sorted(form.scales.items()))
    return digest({"goal": bddl.format(form.goal), "scales": scales, "sub_tasks": rows})


def normalised(
    subtasks: Sequence[SimpleTask], scene: Scene, choose: Choose | None = None
) -> tuple[tuple[SimpleTask, ...], tuple[Rewrite, ...]]:
    """Returns subtasks in order, to which no rule applies any more, and the changes that led there.

    Exchanging independent parts makes new neighbours, so rules and order follow each other until nothing changes. The
    arguments are those of `rewritten`.
    """
    current, made = rewritten(subtasks, scene, choose)
    while (placed := ordered(survey(current, scene))) != current:
        current, more = rewritten(placed, scene, choose)
        made = (*made, *more)
    return current, made


def rewritten(
    subtasks: Sequence[SimpleTask], scene: Scene, choose: Choose | None = None
) -> tuple[tuple[SimpleTask, ...], tuple[Rewrite, ...]]:
    """Returns subtasks to which no rule applies any more, and the changes that led there.

    Args:
        subtasks: Subtasks of a well-formed task, names resolved.
        scene: Its scene.
        choose: Picks the next change among all that are possible; by default many are made at once, from the left.
            That the result is the same for every choice is tested, not proven (docs/canonical.md, Rules).
    """
    current = tuple(subtasks)
    made: list[Rewrite] = []
    while True:
        places = survey(current, scene)
        options = changes(places)
        if not options:
            return current, tuple(made)
        chosen = [choose(options)] if choose is not None else _apart(options)
        for change in reversed(chosen):
            current = (*current[: change.index], *change.result, *current[change.index + change.count :])
        made.extend(chosen)


def _apart(options: Sequence[Rewrite]) -> list[Rewrite]:
    """Returns changes that do not see each other: between any two of them a subtask stays as it is.

    Tidying looks at one subtask alone, so all that is untidy is done at once.
    """
    tidying = [change for change in options if change.rule == "tidy"]
    if tidying:
        return tidying
    chosen: list[Rewrite] = []
    free = 0
    for change in options:
        if change.index >= free:
            chosen.append(change)
            free = change.index + change.count + 2
    return chosen


def prepared(task: Task, scene: Scene) -> Task:
    """Returns a task with its names resolved, and its formulas and scales in order."""
    task = with_scene_names(task, resolver(scene))
    subtasks = tuple(replace(s, init=tidy(s.init), goal=tidy_goal(s.goal, s.target)) for s in task.subtasks)
    # A factor of one changes no size; of an object that is not there it is a mistake to be kept.
    scales = {name: scale for name, scale in sorted(task.scales.items()) if scale != 1.0 or name not in scene.objects}
    return replace(task, goal=tidy(task.goal), subtasks=subtasks, scales=scales)


def _goal_of(places: Sequence[Place], goal: bddl.Formula, scene: Scene) -> bddl.Formula:
    """Returns the task goal of a form whose task has none: what it says, in place of how it was worded.

    What is known at the end of the plan holds whenever the plan goes through, so of that the form's own subtasks may
    speak, and the hand. What is not known there stays as the task asked for it, so the verdict stays as well.
    """
    subtasks = [place.subtask for place in places]
    item = held_by(places[-1].work.hand) if places and places[-1].work is not None else None
    held = () if item is None else (bddl.Atom("inside", (item, GRIPPER)),)
    own = dict.fromkeys((*bddl.conjuncts(default_goal(subtasks)), *held))
    known = set(own).difference(unknown_at_end(subtasks, scene, own))
    asked = unknown_at_end(subtasks, scene, bddl.conjuncts(goal))
    return conjunction((*(part for part in own if part in known), *asked))


def _renamed(place: Place) -> SimpleTask:
    """Returns a subtask whose name and description say what it does."""
    subtask = place.subtask
    words = _words(place)
    sentence = f"{words[0].upper()}{words[1:]}."
    return replace(subtask, name=words.replace(" ", "_"), detail=sentence)


def _words(place: Place) -> str:
    """Returns what a subtask does, in words."""
    subtask, target = place.subtask, place.subtask.target
    writes = {} if place.work is None else place.work.writes
    opened = writes.get(("open", target))
    if opened is not None:
        return f"{'open' if opened else 'close'} {target}"
    if place.work is not None and held_by(place.work.hand) == target != held_by(place.hand):
        return f"pick up {target}"
    placement = place.context.placement
    if placement is not None:
        return f"put {target} {'inside' if placement.relation == 'inside' else 'on'} {placement.support}"
    return f"handle {subtask.target}"
