"""Single mistakes in right plans: verdict and place are the simulation's, the mistake is named, a fix is offered."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

import oag
from tests.oag.mutants import Mutant, World0, ill_formed, is_root, is_stop, mutants, same_plan, simulated
from tests.oag.other_tasks import OTHERS
from tests.oag.paper import NAMES, scene, task_json

PLANS: dict[str, tuple[oag.Scene, dict[str, Any]]] = {name: (scene(name), task_json(name)) for name in NAMES}
PLANS |= {name: (oag.Scene.from_json(world), data) for name, (world, data) in OTHERS.items()}
SHORT = ("T1", "T3", "T4")


@pytest.mark.parametrize("name", PLANS)
def test_the_plans_themselves_are_right(name: str) -> None:
    kitchen, data = PLANS[name]
    assert oag.compose(data, kitchen).verify()
    assert ill_formed(data, World0.of(kitchen)) is False
    assert simulated(data, World0.of(kitchen)) is None


def reports(name: str, every: int = 1) -> Iterator[tuple[Mutant, oag.Report]]:
    """The mutants of a plan with their reports: all, or one of `every`."""
    kitchen, data = PLANS[name]
    for number, mutant in enumerate(mutants(data, tuple(kitchen.objects))):
        if number % every == 0:
            yield mutant, oag.compose(mutant.data, kitchen).verify()


def check_verdicts(name: str, every: int) -> None:
    """The verdict is the simulation's, and so is the place of the first error; nearly always it names the mistake."""
    world = World0.of(PLANS[name][0])
    refuted = roots = 0
    for mutant, report in reports(name, every):
        right = ill_formed(mutant.data, world) is False and simulated(mutant.data, world) is None
        assert bool(report) is right, (mutant, str(report))
        if not report:
            assert is_stop(mutant, report, world), (mutant, report.errors)
            refuted += 1
            roots += is_root(mutant, report, PLANS[name][1], world)
    assert roots >= 0.9 * refuted


@pytest.mark.parametrize("name", PLANS)
def test_verdicts_and_roots_agree_with_the_simulation(name: str) -> None:
    check_verdicts(name, every=1 if name in SHORT else 6)


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANS)
def test_all_verdicts_and_roots_agree_with_the_simulation(name: str) -> None:
    check_verdicts(name, every=1)


def check_fixes(name: str, every: int) -> None:
    """A fix that proves the plan is offered for each; nearly all are one error and have the plan itself as a fix."""
    kitchen, data = PLANS[name]
    original = oag.Task.from_json(data, scene=kitchen)
    restored = refuted = alone = 0
    for mutant, report in reports(name, every):
        if report:
            continue
        refuted += 1
        proving = [fix for fix in report.fixes if fix.proves]
        assert proving, (mutant, str(report))
        flows = mutant.kind != "subtask deleted"
        restored += any(same_plan(fix.apply(report.task), original, flows=flows) for fix in proving)
        alone += len(report.errors) == 1
    assert alone >= 0.9 * refuted
    assert restored >= 0.9 * refuted


@pytest.mark.parametrize("name", SHORT)
def test_every_mistake_gets_a_checked_fix(name: str) -> None:
    check_fixes(name, every=3)


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANS)
def test_every_mistake_of_every_plan_gets_a_checked_fix(name: str) -> None:
    check_fixes(name, every=1)
