"""Random scenes, tasks, wordings and mistakes for property-based tests of planners; needs hypothesis (extra `testing`).

    @given(oag.testing.scenes())
    def test_my_planner_reads_scenes_in_any_order(scene):
        assert oag.stability(my_planner, "open the drawer", scene, perturb=["order"])

A failing example shrinks to the smallest one: fewest objects, everything closed and on the first table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import bddl
from bddl.errors import MissingExtra
from oag import authoring
from oag.authoring import PlanStep
from oag.graph import compose
from oag.model.scene import FLOOR, Scene
from oag.model.symbols import GRIPPER, Kind, Primitive, has_inside
from oag.normal_form import resolver, with_scene_names
from oag.rewriting import negated_variants
from oag.task_definition import SimpleTask, Task

try:
    from hypothesis import strategies as st
except ModuleNotFoundError as missing:
    raise MissingExtra("hypothesis", "testing") from missing

SUPPORTS = ("table", "counter", "desk")
FIXTURES = ("drawer", "cabinet", "refrigerator", "microwave")
ITEMS = ("apple", "book", "cup", "bowl", "bottle", "sponge")
_VERBS = ("do", "perform", "handle", "execute")
Strategy = st.SearchStrategy


def scenes(
    *,
    items: Sequence[str] = ITEMS,
    fixtures: Sequence[str] = FIXTURES,
    supports: Sequence[str] = SUPPORTS,
    most_items: int = 3,
    least_fixtures: int = 0,
    most_fixtures: int = 2,
    most_supports: int = 2,
) -> Strategy[Scene]:
    """Return a strategy of small rooms, without boxes, in which everything is known.

    There is one support at least. Items stand on furniture, or in fixtures and other items.

    Args:
        items, fixtures, supports: Categories that are drawn from; the first are the simplest.
        most_items, most_fixtures, most_supports: Most objects of each kind.
        least_fixtures: Fewest things that open.
    """
    return _scenes(
        st.lists(st.sampled_from(supports), min_size=1, max_size=most_supports),
        st.lists(st.sampled_from(fixtures), min_size=least_fixtures, max_size=most_fixtures if fixtures else 0),
        st.lists(st.sampled_from(items), max_size=most_items if items else 0),
    )


@st.composite
def _scenes(draw: st.DrawFn, *categories: Strategy[list[str]]) -> Scene:
    kinds = ("support", "fixture", "item")
    drawn = [(kind, noun) for kind, nouns in zip(kinds, map(draw, categories), strict=True) for noun in nouns]
    objects: dict[str, str] = {}
    facts: list[str] = []
    places: list[str] = []
    for kind, category in drawn:
        key = f"{category}_{sum(other == category for other in objects.values())}"
        if kind == "item":
            facts.append(f"({draw(st.sampled_from(places)).format(key)})")
        elif kind == "fixture" and draw(st.booleans()):
            facts.append(f"(open {key})")
        objects[key] = category
        if kind != "item":
            places.append(f"ontop {{}} {key}")
        if has_inside(category):
            places.append(f"inside {{}} {key}")
    return authoring.scene(objects, facts, "all")


def tasks(scene: Scene, *, most_steps: int = 4) -> Strategy[Task]:
    """Return a strategy of proved tasks in a scene: steps that each work where the one before ends.

    The task goal is what they leave behind. In a scene in which nothing can be done, the only task has no steps.

    Args:
        scene: A scene that knows enough of itself to prove anything.
        most_steps: Most steps.
    """
    return _tasks(scene, most_steps)


@st.composite
def _tasks(draw: st.DrawFn, scene: Scene, most_steps: int) -> Task:
    steps: list[PlanStep] = []
    for _ in range(draw(st.integers(1, max(1, most_steps)))):
        possible = list(_next_steps(scene, steps))
        if not possible:
            break
        steps.append(draw(st.sampled_from(possible)))
    made = authoring.task(scene, steps=steps)
    return replace(made, goal_given=True)


def _next_steps(scene: Scene, steps: Sequence[PlanStep]) -> Iterator[PlanStep]:
    """Yield the steps that work after others, and change something."""
    report = compose(authoring.task(scene, steps=steps)).verify()
    state = report.state_after(len(steps))
    if state is None:
        return
    kinds = {key: thing.kind for key, thing in scene.objects.items()}
    held = next((key for key in kinds if state.holds(f"(inside {key} {GRIPPER})")), None)
    candidates: list[PlanStep] = []
    for key, kind in kinds.items():
        if kind is Kind.ARTICULATED and held is None and state.holds(f"(open {key})") is not None:
            candidates.append(authoring.close(key) if state.holds(f"(open {key})") else authoring.open(key))
        if kind is Kind.ITEM and held is None:
            candidates.append(authoring.pick(key))
        if held is not None and kind is not Kind.ITEM:
            candidates.append(authoring.place(held, ontop=key))
        if held not in (None, key) and has_inside(scene[key].category):
            candidates.append(authoring.place(str(held), inside=key))
    for candidate in candidates:
        if compose(authoring.task(scene, steps=[*steps, candidate])).verify():
            yield candidate


def wordings(task: Task) -> Strategy[Task]:
    """Return a strategy of other texts for a task, which have its canonical form.

    Names and descriptions differ, conjuncts stand in another order, are repeated or denied twice, and ids are spelled
    as models spell them. The task carries its scene.
    """
    return _wordings(task)


@st.composite
def _wordings(draw: st.DrawFn, task: Task) -> Task:
    def reworded(formula: bddl.Formula) -> bddl.Formula:
        parts: list[bddl.Formula] = draw(st.permutations(bddl.conjuncts(formula)))
        twice, denied = draw(st.booleans()), draw(st.booleans())
        if parts and twice:
            parts = [*parts, parts[0]]
        if parts and denied:
            parts = [bddl.Not(bddl.Not(parts[0])), *parts[1:]]
        return parts[0] if len(parts) == 1 else bddl.And(tuple(parts))

    subtasks = []
    for number, subtask in enumerate(task.subtasks, 1):
        verb = draw(st.sampled_from(_VERBS))
        # Of several places for a target the first one counts.
        goal = reworded(subtask.goal) if len(bddl.conjuncts(subtask.goal)) == 1 else subtask.goal
        name, detail = f"{verb}_{number}", f"{verb.title()} it."
        subtasks.append(replace(subtask, name=name, detail=detail, init=reworded(subtask.init), goal=goal))
    worded = replace(task, name=draw(st.sampled_from(_VERBS)), subtasks=tuple(subtasks), goal=reworded(task.goal))
    if task.scene is None:
        return worded
    resolve = resolver(task.scene)
    spelled = {key: draw(st.sampled_from(_spellings(key, resolve))) for key in task.scene.objects}
    return with_scene_names(worded, lambda name: spelled.get(name, name))


def _spellings(key: str, resolve: Callable[[str], str]) -> list[str]:
    """Return the spellings of an id that mean it alone, itself first."""
    spellings = (key, key.upper(), key.capitalize(), key.replace("_", "-"), key.rsplit("_", 1)[0])
    return [text for text in dict.fromkeys(spellings) if resolve(text) == key or key == FLOOR == text]


def mistakes(task: Task) -> Strategy[Task]:
    """Return a strategy of tasks with one mistake: in a subtask, its flow, its objects, its goal, or the task goal.

    A step or a subtask is left out, two subtasks change places, another object is named, or a literal is denied. Few of
    them are harmless. A task without subtasks gets another task goal.
    """
    return _mistakes(task)


@st.composite
def _mistakes(draw: st.DrawFn, task: Task) -> Task:
    subtasks = list(task.subtasks)
    kinds = ["goal", *(["drop", "object", "subgoal"] if subtasks else []), *(["swap"] if len(subtasks) > 1 else [])]
    kinds += ["step"] if any(subtask.flow for subtask in subtasks) else []
    kind = draw(st.sampled_from(kinds))
    if kind == "goal":
        return replace(task, goal=draw(_denied(task.goal)), goal_given=True)
    index = draw(st.integers(0, len(subtasks) - (2 if kind == "swap" else 1)))
    if kind == "drop":
        del subtasks[index]
    elif kind == "swap":
        subtasks[index : index + 2] = subtasks[index + 1], subtasks[index]
    elif kind == "object":
        subtasks[index] = draw(_with_another_object(subtasks[index], task))
    elif kind == "subgoal":
        subtasks[index] = replace(subtasks[index], goal=draw(_denied(subtasks[index].goal)))
    else:
        index = draw(st.sampled_from([place for place, subtask in enumerate(subtasks) if subtask.flow]))
        flow = list(subtasks[index].flow or ())
        # A drive to where the robot is, and the way back of an empty hand, may be missing without harm.
        needed = [p for p, a in enumerate(flow) if a.primitive in (Primitive.GRASP, Primitive.UNGRASP)]
        del flow[draw(st.sampled_from(needed or range(len(flow))))]
        subtasks[index] = replace(subtasks[index], flow=tuple(flow))
    return replace(task, subtasks=tuple(subtasks))


def _denied(formula: bddl.Formula) -> Strategy[bddl.Formula]:
    """Return a strategy of a formula with one of its literals denied; one that says nothing becomes impossible."""
    variants = [variant.formula for variant in negated_variants(formula)]
    return st.sampled_from(variants or [bddl.Or(())])


@st.composite
def _with_another_object(draw: st.DrawFn, subtask: SimpleTask, task: Task) -> SimpleTask:
    named = {name for one in task.subtasks for name in one.roles if name is not None}
    known = sorted(named if task.scene is None else {*named, *task.scene.objects})
    others = [name for name in known if name not in subtask.roles] or ["nothing_0"]
    old, new = subtask.target, draw(st.sampled_from(others))
    changed: Any = with_scene_names(
        replace(task, subtasks=(subtask,), scales={}), lambda name: new if name == old else name
    )
    return changed.subtasks[0]  # type: ignore[no-any-return]
