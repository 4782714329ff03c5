"""Strategies for tests of planners: what they promise of their values, and that they shrink to the smallest scene."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from dataclasses import replace

from hypothesis import HealthCheck, Phase, find, given, settings
from hypothesis import strategies as st

import oag
from oag import testing
from oag.compilation import compile_plan
from oag.model.symbols import Kind
from oag.primitives.state import scene_facts, start_state
from oag.primitives.table import needed
from oag.progression import Grade, Trace, holds_throughout
from oag.wellformed import check
from tests.source_tree import ROOT

FEW = settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))


@given(testing.scenes().flatmap(testing.tasks).flatmap(lambda task: st.tuples(st.just(task), testing.wordings(task))))
@FEW
def test_tasks_are_proved_and_wordings_have_their_form(drawn: tuple[oag.Task, oag.Task]) -> None:
    task, worded = drawn
    assert oag.compose(task).verify(), task
    assert oag.canonical_digest(worded) == oag.canonical_digest(task)
    assert oag.compose(oag.canonical(worded)).verify()


def test_nearly_all_mistakes_are_noticed_and_equal_forms_have_equal_verdicts() -> None:
    counts: Counter[str] = Counter()

    @given(
        testing.scenes().flatmap(testing.tasks).flatmap(lambda task: st.tuples(st.just(task), testing.mistakes(task)))
    )
    @settings(FEW, max_examples=40, derandomize=True)
    def count(drawn: tuple[oag.Task, oag.Task]) -> None:
        task, wrong = drawn
        assert wrong != task
        verdict = oag.compose(wrong).verify().verdict
        counts[verdict.value] += 1
        # Two subtasks that do not touch each other may change places: the form is the same, and so is the verdict.
        same = oag.canonical_digest(wrong) == oag.canonical_digest(task)
        counts["same form, other verdict"] += same and verdict is not oag.Verdict.PROVED

    count()
    assert counts["REFUTED"] >= 0.9 * sum(counts[verdict.value] for verdict in oag.Verdict), counts
    assert not counts["same form, other verdict"], counts


@given(
    testing.scenes()
    .flatmap(testing.tasks)
    .flatmap(lambda task: st.one_of(st.just(task), testing.wordings(task), testing.mistakes(task))),
    st.booleans(),
)
@settings(FEW, max_examples=30)
def test_what_holds_throughout_is_what_a_trace_finds(task: oag.Task, closed: bool) -> None:
    assert task.scene is not None
    scene = task.scene if closed else replace(task.scene, closed=frozenset())
    if check(task, scene):
        return
    stated = scene_facts(scene)
    start = start_state(scene, task.subtasks[0].target if task.subtasks else None, stated)
    subtasks, goal = compile_plan(task.subtasks, scene, stated), needed(task.goal)
    trace = Trace(start, scene.categories)
    trace.run(subtasks, goal)
    held = trace.undecided_from is None and all(each.grade is Grade.HOLDS for each in trace.obligations)
    assert holds_throughout(start, subtasks, goal, scene.categories) is held


def opens_first(query: str, scene: oag.Scene) -> oag.Task:
    """A planted bug: of several drawers it opens the one that is listed first, and not the one that the query names."""
    drawers = [key for key, thing in scene.objects.items() if thing.category == "drawer"]
    return oag.task(scene, steps=[oag.open(key) for key in drawers[:1]])


def flips(scene: oag.Scene) -> bool:
    return not oag.stability(opens_first, "open the drawer", scene, n=4, perturb=["order"])


def test_a_planted_bug_shrinks_to_the_smallest_scene_that_shows_it() -> None:
    quick = settings(max_examples=300, derandomize=True, database=None, phases=(Phase.generate, Phase.shrink))
    smallest = find(testing.scenes(), flips, settings=quick)
    kinds = Counter(thing.kind for thing in smallest.objects.values())
    # Two drawers are needed to choose the wrong one; a room has a table anyway.
    assert kinds == {Kind.ARTICULATED: 2, Kind.SUPPORT: 1}
    assert [thing.category for thing in smallest.objects.values()].count("drawer") == 2
    assert smallest.facts == ()
    # No smaller scene shows it, as every scene with fewer objects says.
    for left_out in smallest.objects:
        objects = {key: thing for key, thing in smallest.objects.items() if key != left_out}
        if left_out != "table_0":
            assert not flips(oag.scene(objects, (), "all"))


def test_the_core_needs_no_hypothesis_and_says_what_the_strategies_need() -> None:
    code = (
        "import sys; sys.modules['hypothesis'] = None\n"
        "import oag\n"
        "try:\n    oag.testing\n"
        "except ImportError as problem:\n    print(type(problem).__name__, problem)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("MissingExtra") and "'testing'" in done.stdout
