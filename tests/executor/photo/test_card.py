"""What reconstructions are measured by: the same thing is right in every column, another one by what it is off."""

from __future__ import annotations

import ast
import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.drawn_rooms.score import card_rows, compare_thing, iou, support_counts, turned_rad, visible_box
from benchmarks.drawn_rooms.tracks import MockedDetector, mocked_boxes, noisy, sensed
from executor.assets.library import sample
from oag import SceneObject
from oag.model.scene import about_z
from tests.source_tree import first_party_imports, modules

NOWHERE = np.zeros((0, 3))


def fridge(**changes: object) -> SceneObject:
    """A refrigerator with its hinge on the left, and what is changed of it."""
    one = sample("fridge_one_door", 3)
    return replace(replace(one, parameters={**one.parameters, "hinge": "left"}), **changes)


def test_a_thing_is_right_in_every_column_when_it_is_the_same() -> None:
    found = compare_thing(fridge(), "refrigerator", 900, fridge(), 1.0, NOWHERE)
    assert found.found and found.category_right and found.model_right and found.add_right and found.hinge_right
    assert (found.l2_m, found.turned_rad, found.iou) == pytest.approx((0.0, 0.0, 1.0))


def test_what_is_off_is_off_by_so_much() -> None:
    true = fridge()
    x, y, z = true.position
    moved = compare_thing(true, "refrigerator", 900, fridge(position=(x + 0.3, y, z)), 1.0, NOWHERE)
    assert moved.l2_m == pytest.approx(0.3) and moved.centred_iou == pytest.approx(1.0) and not moved.add_right
    length = true.extent_m[0]
    assert moved.iou == pytest.approx((length - 0.3) / (length + 0.3))
    turned = compare_thing(true, "refrigerator", 900, fridge(orientation=about_z(math.pi)), 1.0, NOWHERE)
    assert turned.turned_rad == pytest.approx(math.pi) and turned.iou == pytest.approx(1.0)
    mirrored = fridge(parameters={**true.parameters, "hinge": "right", "open_fraction": 0.8})
    other = compare_thing(true, "refrigerator", 900, mirrored, 1.0, NOWHERE)
    assert other.hinge_right is False and other.open_right is False and other.drawers_right is None


def test_a_missed_thing_is_wrong() -> None:
    missed = compare_thing(fridge(), "refrigerator", 900, None, None, NOWHERE)
    assert not missed.found and not missed.model_right and missed.iou == 0.0
    rows = dict(card_rows([{"things": [missed.to_json()], "refused": "no floor"}]))
    assert rows["all: recall"] == "0.0 % (0 of 1)" and rows["all: box IoU, missed count 0"].startswith("0.00")
    assert rows["all: L2 [cm]"] == "none"


def test_what_looks_the_same_turned_is_not_turned() -> None:
    table, mug = sample("table_four_legs", 1), sample("mug", 1)
    assert turned_rad(table, replace(table, orientation=about_z(math.pi / 2))) == pytest.approx(0.0, abs=1e-9)
    assert turned_rad(mug, replace(mug, orientation=about_z(math.pi / 2))) == pytest.approx(math.pi / 2)


def test_the_box_of_half_the_points_is_half_the_box() -> None:
    true = sample("counter_plain", 2)
    half = np.asarray(true.extent_m) / 2
    points = np.random.default_rng(0).uniform(-half, half * [0.0, 1.0, 1.0], (20000, 3)) + true.position
    assert iou(true, visible_box(points, true)) == pytest.approx(0.5, abs=0.03)


def test_supports_are_pairs() -> None:
    assert support_counts([("cup", "table")], [("cup", "table"), ("bowl", "table")]) == (1, 1, 2)


def test_the_sensor_is_noisier_far_away_and_loses_edges() -> None:
    depth = np.full((100, 100), 1.0)
    depth[:, 50:] = 4.0
    seen = noisy(depth, np.random.default_rng(0))
    near, far = seen[:, 5:45], seen[:, 55:95]
    assert float(far[far > 0].std()) > 10 * float(near[near > 0].std())
    assert (seen[:, 48:52] == 0).mean() > 0.2 > (near == 0).mean()


def test_real_sensors_are_noisier_share_errors_and_measure_in_steps() -> None:
    for seed in range(5):
        flat = sensed(np.full((120, 160), 2.0), np.random.default_rng(seed))
        seen = flat > 0
        assert 0.011 < float(flat[seen].std()) < 0.031 and (~seen).mean() == pytest.approx(0.05, abs=0.01)
        beside = np.corrcoef(*(part[seen[:, 1:] & seen[:, :-1]] for part in (flat[:, 1:], flat[:, :-1])))[0, 1]
        assert 0.3 < beside < 0.6
        steps = 1.0 / flat[seen] / 0.001
        assert np.abs(steps - np.round(steps)).max() < 1e-6
    depth = np.full((120, 160), 1.0)
    depth[:, 80:] = 4.0
    edged = sensed(depth, np.random.default_rng(0))
    assert (edged[:, 78:82] == 0).mean() > 0.5 > (edged[:, 10:60] == 0).mean()
    far, near = (float(part[part > 0].std()) for part in (edged[:, 90:], edged[:, :70]))
    assert far == pytest.approx(16 * near, rel=0.2)


def test_the_mocked_detector_is_as_bad_as_it_says() -> None:
    mask = np.zeros((200, 200), dtype=bool)
    mask[50:150, 60:160] = True
    masks = {f"cup_{number}": mask for number in range(400)}
    found = mocked_boxes(masks, dict.fromkeys(masks, "cup"), MockedDetector(), np.random.default_rng(0))
    named = sum(one.category == "cup" for one in found.values())
    assert 365 <= len(found) <= 393 and 340 <= named < len(found)
    left = np.array([one.box_px[0] for one in found.values()])
    assert float(left.std()) == pytest.approx(3.0, rel=0.15) and all("mocked" in one.source for one in found.values())


def test_only_one_module_knows_the_simulator_s_ids() -> None:
    """Who reconstructs sees pictures and boxes; of the benchmark, one module reads what body a pixel is of."""
    simulator = ("executor.world", "executor.sim.render.stage", "executor.sim.render.frames", "executor.robot")
    knowing = set()
    for name, path in modules("executor").items():
        if not name.startswith(("executor.photo", "executor.bench.photo")):
            continue
        targets = {found.target for found in first_party_imports(name, path)}
        assert not (name.startswith("executor.photo") and any(one.startswith("executor.bench") for one in targets)), (
            name
        )
        words = {node.attr for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Attribute)}
        if any(one.startswith(simulator) for one in targets) or words & {"legend", "segmentation", "per_scene_id"}:
            knowing.add(name)
    assert knowing == {"executor.bench.photo.truth"}
