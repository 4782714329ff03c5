"""Hollow things that are too wide to be closed around are held by their wall, as far as a finger fits below it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import oag
from executor.assets.asset_geometry import scaled, shifted
from executor.assets.library import asset_for, sample
from executor.assets.model import Asset
from executor.geometry import heading_of, inverse, transform
from executor.planning.cargo import Carried
from executor.planning.collision import CollisionOracle
from executor.planning.grasps import SIDEWAYS_RAD, is_held_at_rim, item_goals, rim_goals, room_below_m
from executor.planning.picks import Pick, explain_rim_failure
from executor.planning.placements import PlacementSpot, rim_placement_goals
from executor.planning.planner import Planner
from executor.planning.stances import HandGoal
from executor.records import FailureKind, Rollout
from executor.rollouts.rollout import rollout
from executor.sim.world import World
from oag import Action, Primitive, Scene, SceneObject
from oag.measurements import measurements_json
from oag.model.robots import PAPER_ROBOT
from oag.model.scene import RobotPose
from tests.executor.helpers import at

TOP_M = 0.60
HOLLOW = ("porcelain_bowl", "cup", "mug", "plate")


def _asset(model: str) -> Asset:
    return asset_for(sample(model, 1))


def _wall_pieces(asset: Asset) -> list[tuple[Any, Any]]:
    """Centres and rotations of the boxes that stand in a ring, from what physics is told."""
    boxes = [s for s in asset.links[0].shapes if s.collides and s.kind == "box"]
    assert asset.rim is not None
    ring = boxes[: asset.rim.sides]
    return [(np.array(s.position_m), Rotation.from_quat(s.orientation, scalar_first=True).as_matrix()) for s in ring]


def test_a_hand_that_comes_sideways_along_a_rim_is_nearly_level_and_closes_on_the_same_wall() -> None:
    asset = _asset("porcelain_bowl")
    usual, sideways = rim_goals(asset, np.eye(4)), rim_goals(asset, np.eye(4), SIDEWAYS_RAD)
    lowest_deg = min(np.rad2deg(np.arcsin(-goal.T_world_eef[2, 2])) for goal in usual)
    flattest_deg = min(np.rad2deg(np.arcsin(-goal.T_world_eef[2, 2])) for goal in sideways)
    assert flattest_deg < 30.0 < lowest_deg

    def holds(goals: list[HandGoal]) -> set[tuple[float, ...]]:
        places = (np.concatenate([goal.T_world_eef[:3, 3], goal.T_world_eef[:3, 1]]) for goal in goals)
        return {tuple(np.round(place, 4).tolist()) for place in places}

    assert holds(sideways) == holds(usual), "it is turned about the axis along which the fingers close"


@pytest.mark.parametrize("model", HOLLOW)
def test_fingers_close_square_on_the_pieces_that_physics_has(model: str) -> None:
    asset = _asset(model)
    assert asset.rim is not None
    pieces = _wall_pieces(asset)
    goals = rim_goals(asset, np.eye(4))
    assert len({round(heading_of(goal.T_world_eef[:3, 3] - np.array(asset.rim.center_m)), 4) for goal in goals}) == len(
        pieces
    )
    for goal in goals:
        point, closing = goal.T_world_eef[:3, 3], goal.T_world_eef[:3, 1]
        centre, R = min(pieces, key=lambda piece: float(np.linalg.norm(piece[0] - point)))
        normal = R[:, int(np.argmax(np.abs(R.T @ closing)))]
        assert abs(float(normal @ closing)) == pytest.approx(1.0, abs=1e-6)
        assert abs(float(normal @ (point - centre))) < 1e-3, "between the fingertips is the middle of the wall"
        assert goal.T_world_eef[2, 2] < 0.0, "the hand comes from above"


@pytest.mark.parametrize("model", HOLLOW)
def test_a_hold_of_the_wall_is_told_from_one_around_all_of_it(model: str) -> None:
    asset = _asset(model)
    for goal in rim_goals(asset, np.eye(4)):
        assert is_held_at_rim(asset, Carried("it", inverse(goal.T_world_eef)))
    small = scaled(asset, 0.05 / min(asset.extent_m[:2]))
    for goal in item_goals(PAPER_ROBOT.hand, small, np.eye(4)):
        assert not is_held_at_rim(small, Carried("it", inverse(goal.T_world_eef)))


@pytest.mark.parametrize("turned", [0.0, 0.1])
def test_what_is_held_by_its_wall_is_put_upright_where_it_is_to_be(turned: float) -> None:
    asset = _asset("porcelain_bowl")
    hand = rim_goals(asset, at(0.5, 0.1, 0.7))[5].T_world_eef
    about = transform(Rotation.from_rotvec([turned, 0.0, 0.0]).as_matrix(), np.zeros(3))
    carried = Carried("it", inverse(hand) @ at(0.5, 0.1, 0.7) @ about)
    spot = PlacementSpot(np.array([1.0, -0.4, TOP_M]), (0.7, -2.0), 0.0)
    goals = rim_placement_goals(asset, spot, 0.004, carried)
    assert goals
    for goal in goals:
        T = goal.T_world_eef @ carried.T_eef_object
        np.testing.assert_allclose(T[:3, 2], [0, 0, 1], atol=1e-9)
        np.testing.assert_allclose(T[:3, 3], spot.point_m + [0, 0, asset.extent_m[2] / 2 + 0.004], atol=1e-9)


def test_the_wall_moves_and_grows_with_the_thing() -> None:
    asset = _asset("mug")
    rim, moved, grown = asset.rim, shifted(asset, (0.1, 0.0, 0.0)).rim, scaled(asset, 0.5).rim
    assert rim is not None and moved is not None and grown is not None
    assert moved.center_m == pytest.approx((rim.center_m[0] + 0.1, *rim.center_m[1:]))
    assert (grown.radius_m, grown.thickness_m, grown.slope_rad) == pytest.approx(
        (rim.radius_m / 2, rim.thickness_m / 2, rim.slope_rad)
    )


def test_what_lies_is_not_taken_by_its_wall() -> None:
    lying = transform(np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]), np.zeros(3))
    assert rim_goals(_asset("porcelain_bowl"), lying) == []
    assert rim_goals(_asset("red_apple"), np.eye(4)) == []


@pytest.fixture
def planner() -> Iterator[Any]:
    """Make a planner for a thing on a table whose near edge is at x = 0.75; closes its worlds at the end."""
    made: list[World] = []

    def make(thing: SceneObject) -> tuple[Planner, World]:
        scene = _scene(thing)
        world, oracle = World(scene), World(scene, oracle=True)
        made.extend((world, oracle))
        world.step()
        found = Planner(CollisionOracle(oracle))
        found.start_subtask(world, 0, 0)
        return found, world

    yield make
    for world in made:
        world.close()


def _scene(*things: SceneObject, facts: tuple[str, ...] = ()) -> Scene:
    tables = [_table("table_0", 1.0, 0.0), _table("table_1", -1.0, 0.3)]
    scene = Scene(name="rims", robot=RobotPose(), objects={obj.id: obj for obj in (*tables, *things)})
    return Scene.from_json(scene.to_json() | {"facts": list(facts), "closed": ["ontop", "inside", "open"]})


def _table(name: str, x_m: float, y_m: float) -> SceneObject:
    return SceneObject(
        name, "table", "four_legs", (x_m, y_m, TOP_M / 2), (1, 0, 0, 0), (0.5, 0.9, TOP_M), (1, 1, 1), {}
    )


def _thing(category: str, size_m: tuple[float, float, float], x_m: float = 0.9, yaw_rad: float = 0.0) -> SceneObject:
    turn = (float(np.cos(yaw_rad / 2)), 0.0, 0.0, float(np.sin(yaw_rad / 2)))
    place = (x_m, 0.0, TOP_M + size_m[2] / 2)
    return SceneObject(f"{category}_0", category, category, place, turn, size_m, (1, 1, 1), {})


@pytest.mark.physics
@pytest.mark.slow
def test_a_plate_on_a_table_leaves_a_finger_no_room_and_one_over_the_edge_does(planner: Any) -> None:
    lift = (Action(Primitive.LIFT_EEF_UP),)
    flat, world = planner(_thing("plate", (0.2, 0.2, 0.02)))
    assert next(Pick(flat, world, "plate_0", lift, np.zeros(3)).rim_stances(), None) is None
    failure = explain_rim_failure(flat, world, "plate_0", np.zeros(3))
    room_m, needed_m = room_below_m(PAPER_ROBOT.hand, world.assets["plate_0"])
    assert failure.kind is FailureKind.TOO_WIDE and room_m < needed_m
    assert measurements_json(failure.measurements)["rim_height_m"] == pytest.approx(room_m, abs=1e-4)
    assert "a finger below it needs" in failure.message
    over, world = planner(_thing("plate", (0.2, 0.2, 0.02), x_m=0.80))
    stance = next(Pick(over, world, "plate_0", lift, np.zeros(3)).rim_stances())
    assert stance.followup.at_rim
    assert over.kinematics.forward(stance.q)[0, 3] < 0.75, "held where it hangs over"


def _moved(thing: SceneObject) -> Rollout:
    """Take a thing from one table to another."""
    name = thing.id
    scene = _scene(thing, facts=(f"(ontop {name} table_0)",))
    fields = {"task_detail_message": "", "support_init": None, "support_goal": None, "target": name}
    pick = {
        "task_activity_name": "pick",
        "support_init": "table_0",
        "init": f"(ontop {name} table_0)",
        "goal": f"(not (ontop {name} table_0))",
        "flow": [17, 1, 2, 3, {"7": None}],
    }
    place = {
        "task_activity_name": "place",
        "support_goal": "table_1",
        "init": f"(inside {name} gripper)",
        "goal": f"(ontop {name} table_1)",
        "flow": [18, {"13": None}, {"8": None}, 5, 6],
    }
    task = {
        "task_activity_name": "move",
        "task_detail_message": "",
        "goal": f"(ontop {name} table_1)",
        "sub_tasks": [fields | pick, fields | place],
    }
    graph = oag.compose(oag.Task.from_json(task, scene=scene), scene=scene)
    assert graph.verify().verdict is oag.Verdict.PROVED
    return rollout(graph, seed=1, vary=False)


@pytest.mark.physics
@pytest.mark.parametrize(
    "thing",
    [
        pytest.param(_thing("bowl", (0.15, 0.15, 0.05), yaw_rad=0.3), id="bowl"),
        pytest.param(_thing("bowl", (0.20, 0.20, 0.07)), id="wide_bowl", marks=pytest.mark.slow),
        pytest.param(_thing("cup", (0.075, 0.075, 0.09)), id="cup", marks=pytest.mark.slow),
        pytest.param(_thing("mug", (0.11, 0.08, 0.09), yaw_rad=2.0), id="mug", marks=pytest.mark.slow),
    ],
)
@pytest.mark.slow
def test_what_is_too_wide_is_carried_by_its_wall_and_put_down_upright(thing: SceneObject) -> None:
    done = _moved(thing)
    assert done.succeeded, done.failure
    grasp = next(step for step in done.subtasks[0].steps if step.primitive == "GRASP")
    assert measurements_json(grasp.measurements)["target_width_m"] == pytest.approx(0.004, abs=1e-3)
    force_n = measurements_json(grasp.measurements)["grip_force_n"]
    assert isinstance(force_n, float) and force_n > 25.0
    poses = done.trajectory.object_poses[thing.id]
    lifted = poses[np.flatnonzero(done.trajectory.subtask == 0)[-1]]
    assert lifted[2] - thing.position[2] > 0.10
    _, x, y, _ = poses[-1][3:]
    assert 1 - 2 * (x * x + y * y) > 0.999, "upright"


@pytest.mark.physics
def test_what_is_too_heavy_for_its_wall_slips_and_is_said_to() -> None:
    done = _moved(_thing("bowl", (0.30, 0.30, 0.10)))
    assert done.failure is not None and done.failure.kind is FailureKind.SLIPPED
