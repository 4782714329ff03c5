"""The canonical form of a task: one form for all the ways in which one decomposition can be written down.

    oag.canonical(task) == oag.canonical(reworded)

Source: docs/canonical.md; the paper's repeated decomposition study, which this makes a statement about formulas.
"""

from __future__ import annotations

from dataclasses import replace

import bddl
from oag.certificate.contents import digest
from oag.flows.completion import complete
from oag.model.scene import Scene
from oag.normal_form.formulas import tidy, tidy_goal
from oag.normal_form.movements import movements
from oag.normal_form.names import resolver, with_scene_names
from oag.normal_form.order import content, ordered
from oag.progression.progress import Trace
from oag.task.goals import default_goal
from oag.task.task import Task, chosen_scene
from oag.task.wellformed import check
from oag.verify import follow


def canonical(task: Task, scene: Scene | None = None) -> Task:
    """Returns the canonical form of a task.

    Names are resolved to the scene's ids and formulas sorted. A plan that is PROVED is then cut anew where the hand is
    at rest, its conditions say what each part changes, parts that change nothing are left out, and independent parts
    are put in one order. A plan that is not proved keeps its subtasks.

    Args:
        task: The task.
        scene: The scene it is for; by default the one that the task carries.

    Returns:
        A task with the same verdict, whose runs end as those of the task. Its canonical form is itself.

    Raises:
        MissingScene: There is no scene, neither here nor with the task.
        TaskError, SceneError: An argument is no `Task`, or no `Scene`.

    Source: docs/canonical.md.
    """
    chosen = chosen_scene(task, scene)
    named = _named(task, chosen)
    planned, trace = _proved(named, chosen)
    if trace is None:
        return named
    subtasks = ordered(movements(named, planned, trace))
    form = replace(named, subtasks=subtasks, goal=named.goal if named.goal_given else default_goal(subtasks))
    # What a rounded sum of moves or a goal read off anew may change is not worth a form with another verdict.
    return named if _proved(form, chosen)[1] is None else form


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


def _named(task: Task, scene: Scene) -> Task:
    """Returns a task with its names resolved, and its formulas and scales in order."""
    task = with_scene_names(task, resolver(scene))
    subtasks = tuple(replace(s, init=tidy(s.init), goal=tidy_goal(s.goal, s.target)) for s in task.subtasks)
    # A factor of one changes no size; of an object that is not there it is a mistake to be kept.
    scales = {name: scale for name, scale in sorted(task.scales.items()) if scale != 1.0 or name not in scene.objects}
    return replace(task, goal=tidy(task.goal), subtasks=subtasks, scales=scales)


def _proved(task: Task, scene: Scene) -> tuple[Task, Trace | None]:
    """Returns a plan with a flow for every subtask, and how it goes; None when it is not proved."""
    planned = complete(task, scene).task
    if check(planned, scene):
        return planned, None
    trace = follow(planned, scene)
    open_ends = trace.failures or trace.assumptions or trace.undecided_from is not None
    return planned, None if open_ends else trace
