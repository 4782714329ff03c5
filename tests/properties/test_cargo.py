"""Plans with cargo, judged by an oracle in which everything but direct relations is derived."""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

import oag
from oag.model.symbols import Fact
from oag.primitives.cargo import NOTHING_CARRIED, Starts, carriage_of
from tests.bruteforce import added, completions
from tests.carried import PLACES, copied, outcome, plan_from, possible, scene_json, start, task_json, wishes

VERDICTS = {True: "PROVED", False: "REFUTED", None: "CONDITIONAL"}


def check_plan(draw: Random) -> str:
    """Compare the verdict on a random plan with its one run, and check the certificate; returns the verdict."""
    world = start(draw)
    plan, end = plan_from(draw, world)
    goal = wishes(draw, end, world.beside)
    world.base = plan[0].target
    expected = VERDICTS[outcome(copied(world), plan, goal)]
    scene = oag.Scene.from_json(scene_json(draw, world))
    task = oag.Task.from_json(task_json(plan, goal), scene=scene)
    report = oag.compose(task).verify()
    assert report.verdict.value == expected, f"{expected} expected\n{report}\n{scene.facts}\n{task.to_json()}"
    if report.trace is None:
        return "not well formed"
    result = oag.recheck(report.certificate, task=task, scene=scene)
    assert result, f"{result.reason}\n{report}"
    return expected


def check_open(draw: Random) -> str:
    """Compare the verdict on a plan from a start that is known in part with all its runs; returns the verdict."""
    world = start(draw)
    plan, end = plan_from(draw, world)
    goal = wishes(draw, end, ())
    world.base = plan[0].target
    moved = {name for part in plan for name in world.load(part.target)}
    unknown = draw.sample([fact for fact in PLACES if moved & set(fact[1:])], draw.randrange(1, 5))
    outcomes = {outcome(copied(each), plan, goal) for each in possible(world, unknown)}
    scene = oag.Scene.from_json(scene_json(draw, world, unknown))
    report = oag.compose(oag.Task.from_json(task_json(plan, goal), scene=scene)).verify()
    # Where it is open what carries what, an answer may be left open that there is.
    said = [truth for truth, word in VERDICTS.items() if word == report.verdict.value]
    assert said == [None] or outcomes == set(said), f"{outcomes}\n{report}\n{unknown}\n{world}"
    result = oag.recheck(report.certificate)
    assert report.trace is None or result, f"{result.reason}\n{report}"
    return report.verdict.value


@given(st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_a_verdict_on_cargo_is_that_of_its_run(draw: Random) -> None:
    event(check_plan(draw))


@pytest.mark.slow
def test_verdicts_on_ten_thousand_plans_with_cargo() -> None:
    found = Counter(check_plan(Random(seed)) for seed in range(10_000))
    assert found["PROVED"] > 3_000 and found["REFUTED"] > 1_500


@given(st.randoms(use_true_random=False))
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_a_verdict_on_cargo_that_is_known_in_part_is_that_of_all_runs(draw: Random) -> None:
    event(check_open(draw))


@pytest.mark.slow
def test_verdicts_on_two_thousand_plans_with_cargo_that_is_known_in_part() -> None:
    found = Counter(check_open(Random(seed)) for seed in range(2_000))
    assert found["PROVED"] > 300 and found["REFUTED"] > 300


ON_ITEMS = ("cup_0", "cup_1", "plate_0")
ON_FACTS: tuple[Fact, ...] = tuple(
    (relation, item, place)
    for relation in ("ontop", "inside")
    for item in ON_ITEMS
    for place in (*ON_ITEMS, "fridge_0")
    if place != item
)


@given(st.sets(st.sampled_from(ON_FACTS), max_size=4), st.lists(st.sampled_from(ON_FACTS), max_size=7), st.data())
@settings(max_examples=150, deadline=None)
def test_what_carries_what_excludes_exactly_the_values_that_no_start_has(
    drawn: set[Fact], unknown: list[Fact], data: st.DataObject
) -> None:
    """Facts get values one after another; the oracle lists every start that is left."""
    true = frozenset[Fact]()
    for fact in sorted(drawn):
        true = added(true, fact)
    known = {fact: fact in true for fact in ON_FACTS if fact not in unknown}
    worlds = [world.true for world in completions(known, tuple(dict.fromkeys(unknown)), None)]
    starts = Starts(carriage_of((*ON_ITEMS, "fridge_0"), ON_ITEMS, known, ()), known.get)
    given: dict[Fact, bool] = {}
    for fact in dict.fromkeys(unknown):
        left = {value: [true for true in worlds if (fact in true) is value] for value in (False, True)}
        for value, found in left.items():
            assert starts.exclude(fact, value, given) is (not found and starts.carriage != NOTHING_CARRIED), fact
        given[fact] = data.draw(st.sampled_from([value for value, found in left.items() if found]))
        worlds = left[given[fact]]
