"""A robot on a lift takes things from high tops at their own sizes, and its lift stays within its range."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import llm
import oag
from executor.planning.choices import SAME_PLACE_M
from executor.records import SubtaskRecord
from executor.rollouts.feasibility import feasible
from executor.rollouts.rollout import rollout
from executor.scenes.file import load_scene
from executor.scenes.generators.families import indices_of, pair_of
from oag import Scene
from oag.measurements import SupportDrive, TargetDrive, first_of
from oag.model.robots import LIFTED

TOP_M = 0.944


def kitchen(folder: Path) -> Scene:
    objects = {
        "countertop_0": {"category": "countertop", "position": [1.3, 0.0, TOP_M / 2], "bbox_extent": [0.6, 1.4, TOP_M]},
        "table_0": {"category": "table", "position": [-0.2, 1.4, 0.375], "bbox_extent": [0.8, 0.6, 0.75]},
        "item_0": {"category": "soda_can", "position": [1.25, 0.1], "on": "countertop_0"},
    }
    file = folder / "kitchen.json"
    file.write_text(
        json.dumps({"name": "kitchen", "robot": {"position": [0, 0], "name": LIFTED.name}, "objects": objects})
    )
    return load_scene(str(file))


@pytest.mark.physics
@pytest.mark.slow
def test_a_can_is_taken_from_a_counter_and_put_on_a_table_as_the_dry_run_chose(tmp_path: Path) -> None:
    scene = kitchen(tmp_path)
    proposal = llm.propose("put the soda can on the table", scene)
    assert set(proposal.task.scales.values()) == {1.0}
    graph = oag.compose(proposal.task, scene=scene)
    found = feasible(graph, scene, seed=4, vary=False)
    assert found and all(subtask.choices for subtask in found.subtasks)
    done = rollout(graph, scene, seed=4, vary=False, conditions=found.conditions())
    assert done.succeeded, done.failure
    lift_m = done.trajectory.robot_qpos[:, 3]
    assert lift_m.max() > 0.05 and lift_m.min() > -0.005 and lift_m.max() < LIFTED.lift_m + 0.005
    for planned, ran in zip(found.subtasks, done.subtasks, strict=True):
        drives = [first_of(step.measurements, TargetDrive) for step in ran.steps]
        bases = [(drive.base_x_m, drive.base_y_m) for drive in drives if drive is not None]
        if planned.base is not None:
            assert np.hypot(*(np.array(bases[0]) - planned.base[:2])) < SAME_PLACE_M
    regions = [drive.region for ran in done.subtasks for drive in _places(ran)]
    assert regions == [subtask.region for subtask in found.subtasks if subtask.region is not None]


def _places(record: SubtaskRecord) -> list[SupportDrive]:
    found = (first_of(step.measurements, SupportDrive) for step in record.steps)
    return [drive for drive in found if drive is not None]


@pytest.mark.physics
@pytest.mark.slow
def test_the_hand_comes_out_of_a_compartment_where_straight_ways_home_are_tried_before_trees() -> None:
    pair = pair_of("T2", 11, indices_of("T2")[0], robot=LIFTED.name)
    done = rollout(oag.compose(pair.task), pair.scene, seed=11)
    assert done.succeeded, done.failure
