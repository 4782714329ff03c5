"""A robot on a lift takes things from high tops at their own sizes, and its lift stays within its range."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import llm
import oag
from executor.rollouts.rollout import rollout
from executor.scenes.file import load_scene
from oag.model.robots import LIFTED

TOP_M = 0.944


@pytest.mark.physics
@pytest.mark.slow
def test_a_can_is_taken_from_a_counter_and_put_on_a_table(tmp_path: Path) -> None:
    objects = {
        "countertop_0": {"category": "countertop", "position": [1.3, 0.0, TOP_M / 2], "bbox_extent": [0.6, 1.4, TOP_M]},
        "table_0": {"category": "table", "position": [-0.2, 1.4, 0.375], "bbox_extent": [0.8, 0.6, 0.75]},
        "item_0": {"category": "soda_can", "position": [1.25, 0.1], "on": "countertop_0"},
    }
    file = tmp_path / "kitchen.json"
    file.write_text(
        json.dumps({"name": "kitchen", "robot": {"position": [0, 0], "name": LIFTED.name}, "objects": objects})
    )
    scene = load_scene(str(file))
    proposal = llm.propose("put the soda can on the table", scene)
    assert set(proposal.task.scales.values()) == {1.0}
    done = rollout(oag.compose(proposal.task, scene=scene), scene, seed=4, vary=False)
    assert done.succeeded, done.failure
    lift_m = done.trajectory.robot_qpos[:, 3]
    assert lift_m.max() > 0.05 and lift_m.min() > -0.005 and lift_m.max() < LIFTED.lift_m + 0.005
