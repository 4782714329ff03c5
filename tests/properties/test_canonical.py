"""Properties 16 to 21: the canonical form against noise, against simulation, and against itself."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

import bddl
import oag
from benchmarks.noise import corrupted, variant
from benchmarks.noise_tasks import BaseTask, ten_tasks
from oag.model.symbols import GRIPPER
from oag.normal_form import resolver, with_scene_names
from oag.wellformed import check
from tests.bruteforce import Literal, Part, World, act, allowed
from tests.properties.noisy import noisy_cases
from tests.properties.plans import KINDS, Case, cases

FEW = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
MANY = settings(max_examples=2000, deadline=None, suppress_health_check=[HealthCheck.too_slow])
BASES = ten_tasks()
SCENES = {base.name: oag.Scene.from_json(base.scene) for base in BASES}
FORMS = {
    base.name: oag.canonical(
        oag.Task.from_json({"goal": f"(and {' '.join(base.goal)})", "sub_tasks": base.subtasks, "scales": base.scales}),
        SCENES[base.name],
    )
    for base in BASES
}
bases = st.sampled_from(BASES)
seeds = st.integers(0, 10**9)


def task_of(base: BaseTask, data: dict[str, object]) -> oag.Task:
    """A variant as a task in its scene."""
    return oag.Task.from_json(data, scene=SCENES[base.name])


def meaning(task: oag.Task) -> tuple[object, ...]:
    """What two canonical forms are compared by: everything but the name and description of the whole task."""
    return task.subtasks, task.goal, task.goal_given, dict(task.scales)


def literals(formula: bddl.Formula) -> tuple[Literal, ...]:
    """A conjunction of literals as the oracle has it."""
    return tuple(((found.atom.predicate, *found.atom.args), found.value) for found in bddl.literals(formula) or ())


def parts_of(task: oag.Task) -> tuple[Part, ...]:
    """The subtasks of a task as the oracle has them."""
    return tuple(
        Part(
            s.target,
            s.support_goal,
            literals(s.init),
            literals(s.goal),
            tuple((int(action.primitive), action.parameter) for action in s.flow or ()),
        )
        for s in task.subtasks
    )


def end_of(start: World, task: oag.Task) -> World | None:
    """The state in which a plan ends from a start state, None when it fails on the way or misses its goal."""
    world = replace(start, base=task.subtasks[0].target if task.subtasks else None)
    for part in parts_of(task):
        if not all(map(world.holds, part.init)):
            return None
        for action in part.flow:
            if not allowed(world, part, action, KINDS):
                return None
            world = act(world, part, action, KINDS)
        if not all(map(world.holds, part.goal)):
            return None
    return world if all(map(world.holds, literals(task.goal))) else None


def same_end(first: World | None, second: World | None) -> bool:
    """Whether two runs end in the same state of the world; where the robot stands is no part of it."""
    if first is None or second is None:
        return first is second
    return (first.true, first.hand) == (second.true, second.hand)


def without_goal(case: Case) -> oag.Task:
    """A random plan whose task goal is read off its subtasks."""
    data = {key: value for key, value in case.task_json().items() if key != "goal"}
    return oag.Task.from_json(data, scene=case.scene())


def check_meaning(case: Case) -> None:
    """16, 18 and 19 on one random plan, with its goal and without."""
    for task in (case.task(), without_goal(case)):
        check_meaning_of(task, case)


def check_meaning_of(task: oag.Task, case: Case) -> None:
    """16, 18 and 19 on one task."""
    form = oag.canonical(task)
    assert meaning(oag.canonical(form)) == meaning(form)
    if check(task, task.scene):
        return
    before, after = (oag.compose(t).verify() for t in (task, form))
    event(before.verdict.value)
    assert before.verdict is after.verdict, f"{before}\n{after}"
    for start in case.starts():
        assert same_end(end_of(start, task), end_of(start, form)), start


@given(st.one_of(cases(), noisy_cases()))
@FEW
def test_p16_p18_p19_the_form_is_stable_and_means_the_same(case: Case) -> None:
    check_meaning(case)


@pytest.mark.slow
@given(st.one_of(cases(most_unknown=6), noisy_cases(most_unknown=6)))
@MANY
def test_p16_p18_p19_at_length(case: Case) -> None:
    check_meaning(case)


def check_invariance(base: BaseTask, seed: int) -> None:
    """17 and 16 on one noisy variant."""
    noisy = variant(base, seed)
    form = oag.canonical(task_of(base, noisy.task))
    assert meaning(form) == meaning(FORMS[base.name]), noisy.changes
    assert meaning(oag.canonical(form, SCENES[base.name])) == meaning(form)


@given(bases, seeds)
@FEW
def test_p17_noise_does_not_matter(base: BaseTask, seed: int) -> None:
    check_invariance(base, seed)


@pytest.mark.slow
@given(bases, seeds)
@MANY
def test_p17_at_length(base: BaseTask, seed: int) -> None:
    check_invariance(base, seed)


def check_discrimination(base: BaseTask, seed: int) -> None:
    """21: a broken variant has another form, or its form is refuted."""
    broken = corrupted(base, seed)
    task = task_of(base, broken.task)
    form = oag.canonical(task)
    event(f"{broken.changes[0]}: {oag.compose(form).verify().verdict.value}")
    assert meaning(form) != meaning(FORMS[base.name]), broken.changes


@given(bases, seeds)
@FEW
def test_p21_broken_variants_are_told_apart(base: BaseTask, seed: int) -> None:
    check_discrimination(base, seed)


@pytest.mark.slow
@given(bases, seeds)
@MANY
def test_p21_at_length(base: BaseTask, seed: int) -> None:
    check_discrimination(base, seed)


@given(bases, seeds, st.randoms(use_true_random=False))
@FEW
def test_p17_renaming_the_scene_renames_the_form(base: BaseTask, seed: int, rng: random.Random) -> None:
    scene = SCENES[base.name]
    numbers = rng.sample(range(100, 1000), len(scene.objects))
    new = {old: f"thing_{number}" for old, number in zip(scene.objects, numbers, strict=True)}

    def rename(name: str) -> str:
        return new.get(name, name)

    def renamed_scene() -> oag.Scene:
        data = scene.to_json()
        objects = {new[key]: value for key, value in data["objects"].items()}  # type: ignore[attr-defined]
        facts = [bddl.format(oag_renamed(fact)) for fact in scene.facts]
        return oag.Scene.from_json({**data, "objects": objects, "facts": facts})

    def oag_renamed(formula: bddl.Formula) -> bddl.Formula:
        goal_only = oag.Task("", "", formula, True, ())
        return with_scene_names(goal_only, rename).goal

    task = task_of(base, variant(base, seed).task)
    plain = with_scene_names(task, resolver(scene))
    other = renamed_scene()
    renamed_form = with_scene_names(oag.canonical(task), rename)
    assert meaning(oag.canonical(with_scene_names(plain, rename), other)) == meaning(oag.canonical(renamed_form, other))
    assert GRIPPER not in new.values()
