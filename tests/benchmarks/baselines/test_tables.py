"""The scripts beside the baselines: recorded decompositions that are verified, and the table of a folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import robogen_executed, robogen_plans
from benchmarks.baselines import table
from executor.bench.folder import BenchFolder
from executor.bench.units import BenchSetting, Series
from executor.records import FailureKind
from tests.source_tree import ROOT

# Of the form of RoboGen's examples, written for this test.
CONFIGURATION = """\
- use_table: true
- center: (1.0, 0.2, 0)
  lang: a cold cupboard
  name: ColdCupboard
  size: 1.8
  type: urdf
- center: (0.5, 0.5, 0)
  lang: a red pear
  name: Pear
  size: 0.08
  type: mesh
- set_joint_angle_object_name: ColdCupboard
- spatial_relationships: []
- task_description: The robot keeps the pear cold
  task_name: keep cold
"""
KEEP = (
    "grasp the cold cupboard door\nopen the cold cupboard door\n{release}"
    "grasp the pear\nmove the pear into the cold cupboard\n"
)
RELEASE = "release the cold cupboard door\n"
END = "release the pear\ngrasp the cold cupboard door again\nclose the cold cupboard door"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    plans = {
        "complete": KEEP.format(release=RELEASE) + END,
        "never_lets_go": KEEP.format(release="") + END.removeprefix("release the pear\n"),
        "twist": " grasp the cold cupboard door\n twist the door",
    }
    for name, steps in plans.items():
        folder = tmp_path / "example_tasks" / name / f"task_{name}"
        folder.mkdir(parents=True)
        (folder.parent / "a_task.yaml").write_text(CONFIGURATION)
        (folder.parent / "a_distractor.yaml").write_text("- name: pot\n  size: 0.3\n  type: mesh\n")
        (folder / "substeps.txt").write_text(steps)
    return tmp_path


def test_recorded_decompositions_are_verified_as_written_and_as_their_code_does(
    checkout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert robogen_plans.main([str(checkout)]) == 0
    told = capsys.readouterr().out
    assert "complete: PROVED as written, PROVED as its code does" in told
    assert "never_lets_go: REFUTED as written, PROVED as its code does" in told
    assert "3 decompositions; 1 outside the language: {'twist': 1}" in told
    assert "as written: {'PROVED': 1, 'REFUTED': 1, 'with a proved fix': 1}" in told


def test_what_is_no_checkout_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert robogen_plans.main([str(tmp_path)]) == 2 and table.main([str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("usage") == 2


def test_the_paper_stands_in_a_column_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = BenchFolder(tmp_path)
    ours, theirs = (Series("T2", 1, 2, BenchSetting(baseline=name), "v") for name in (None, "constraint-pose"))
    folder.add_series([ours, theirs])
    for series in (ours, theirs):
        for unit in series.units():
            ended = "succeeded" if series is ours else "failed"
            more = {} if series is ours else {"grasps_tried": 3, "grasps_held": 1, "mistake": "wrong order"}
            folder.write(unit, "v", {"ended": ended, "simulated_s": 4.0, **more})
    assert table.main([str(tmp_path)]) == 0
    head, _, other, own, *elsewhere, grasps, mistakes = capsys.readouterr().out.splitlines()
    assert grasps == "like GenSim2 (own code): 2 of 6 grasps with both fingers"
    assert mistakes == "like GenSim2 (own code), wrong order: 0 of 2"
    assert head.split("|")[-2].strip().startswith("the paper's own row")
    assert "| like GenSim2 (own code) | own | 1 to 2 | 0 of 2, 0 % (0.0 to 84.2) | 0 | 8 s |" in other
    assert other.endswith("| M3 GenSim2 (Primitive): 5 / 78 |")
    assert "2 of 2, 100 %" in own and own.endswith("| 0 s | - |")
    # What was measured with code or tasks of others stands below, in the same columns.
    assert len(elsewhere) == 15 and {row.count("|") for row in elsewhere} == {head.count("|")}
    theirs_own = next(row for row in elsewhere if "GenSim2's OpenRefrigeratorDoor" in row)
    assert "| GenSim2's | 0 to 19 | 13 of 20, 65 % (40.8 to 84.6) |" in theirs_own and "not measured anew" in theirs_own
    assert theirs_own.endswith("| M3 GenSim2 (Primitive), T1 to T6: 0, 5, 55, 0, 100, 38.8 |")


def test_what_was_measured_elsewhere_is_what_the_documentation_says() -> None:
    told = " ".join((ROOT / "docs/baselines.md").read_text(encoding="utf-8").split())
    for one in table.ELSEWHERE:
        assert one.source in told
    for task, good in table.GENSIM2.items():
        assert f"{task} {good} " in told
    for one in (table.ELSEWHERE[-5], *table.ELSEWHERE[-2:]):
        assert f"{one.rate.successes} of {one.rate.trials}" in told
    assert "| as written: a hand lets go only where a step says so | 11 | 9 |" in told
    assert "| as its code does: a grasp first lets go of what is held | 19 | 1 |" in told


@pytest.mark.slow
@pytest.mark.physics
@pytest.mark.parametrize("lets_go", [False, True])
def test_recorded_decompositions_are_executed_without_being_checked(lets_go: bool) -> None:
    steps = ("grasp the drawer", "open the drawer", "grasp the object", "put the object into the drawer")
    rest = ("grasp the drawer again", "close the drawer")
    stored = {"facts": ["(ontop object_0 floor_0)", "(not (open storage_furniture_0))"], "objects": {}}
    plan = robogen_plans.Recorded(
        "Store_an_Object_in_the_Drawer", (*steps, *rest), stored, "storage_furniture_0", ("object_0",)
    )
    scene, task = robogen_executed.prepared(plan, grasping_lets_go=lets_go)
    assert str(task.goal) == "(and (inside object_0 storage_furniture_0) (not (open storage_furniture_0)))"
    rollout = robogen_executed.executed(scene, task, 62950)
    assert rollout.succeeded is lets_go
    # Who never lets go of the drawer comes to the object with its handle in the hand.
    assert lets_go or (rollout.failure is not None and rollout.failure.kind is FailureKind.PRECONDITION)
