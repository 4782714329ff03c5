"""Things are found where they are, as they are, from depths and colours that are cast at them ray by ray."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from executor.assets.footprint import Footprint, overlap_depth_m, solid_parts, swept_parts
from executor.assets.library import LIBRARY, asset_for
from executor.assets.parameters import AssetError
from executor.geometry import Array
from executor.photo.fitting.fit import fit_thing
from executor.photo.fitting.hypothesis import PoseHypothesis, as_built, raycaster_of
from executor.photo.fitting.likelihood import Neighbourhood, SearchContext, prior_cost
from executor.photo.fitting.refinement import is_same_box
from executor.photo.fitting.starts import opened_starts, points_of, starts
from executor.photo.geometry.observation import Noise, Observation
from executor.photo.geometry.walls import Wall
from executor.photo.inputs.annotations import Detection
from executor.photo.inputs.picture import Intrinsics
from executor.photo.overlaps import resolve_overlaps
from executor.photo.room.estimate import is_on_one, tops_of
from executor.photo.room.reconstruct import FittedRoom, reconstruct
from executor.photo.scene import scene_json, scene_of, variations_of
from executor.scenes.file import complete_scene
from executor.scenes.validation import issues

SIZE = (320, 240)
CAMERA = Intrinsics(280.0, 280.0, 160.0, 120.0, "drawn")
DOWN_RAD = math.radians(25.0)
TABLE = PoseHypothesis(LIBRARY["table_four_legs"], 2.2, 0.1, 0.3, 0.0, (1.0, 0.6, 0.7))
BOWL = PoseHypothesis(LIBRARY["porcelain_bowl"], 2.05, -0.05, 0.0, 0.7, (0.17, 0.17, 0.06))
COLOURS = ((120, 120, 115), (150, 100, 60), (40, 70, 160))


def seen_from_above(*things: PoseHypothesis, finer: int = 1) -> tuple[Observation, list[Detection]]:
    """Return what a camera 1.5 m above the floor sees of some things, with noise, and exact boxes of them."""
    camera = replace(CAMERA, **{name: finer * getattr(CAMERA, name) for name in ("fx", "fy", "cx", "cy")})
    c, s = math.cos(DOWN_RAD), math.sin(DOWN_RAD)
    R = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]) @ np.eye(3)
    R = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ R
    rays, eye = camera.rays((finer * SIZE[0], finer * SIZE[1])) @ R.T, np.array([0.0, 0.0, 1.5])
    with np.errstate(divide="ignore"):
        z = np.where(rays[..., 2] < -1e-6, -eye[2] / rays[..., 2], np.inf)
    owner = np.zeros(z.shape, dtype=int)
    for number, thing in enumerate(things, start=1):
        body = raycaster_of(thing)
        assert body is not None
        depth: Array = body.depth(thing, eye, rays.reshape(-1, 3)).reshape(z.shape)
        owner[depth < z] = number
        z = np.minimum(z, depth)
    noise = Noise(0.001, 0.002)
    z = np.where(z < 8.0, z, 0.0)
    z = np.where(z > 0.0, z + np.random.default_rng(0).normal(size=z.shape) * noise.sigma_m(z), 0.0)
    rgb = np.array(COLOURS, dtype=np.uint8)[owner % len(COLOURS)]
    boxes = []
    for number, thing in enumerate(things, start=1):
        rows, columns = np.nonzero(owner == number)
        box = (float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1))
        boxes.append(Detection(thing.entry.category, thing.entry.category, box, 1.0, "drawn"))
    return Observation(rgb, z, rays, eye, R.T, noise, camera), boxes


@pytest.fixture(scope="module")
def room() -> FittedRoom:
    """A table with a bowl on it, as it was reconstructed."""
    observation, boxes = seen_from_above(TABLE, BOWL)
    return reconstruct(observation, boxes, ())


def test_an_open_door_is_believed_from_its_front_and_hardly_from_behind() -> None:
    alone = Neighbourhood(())
    costs = {}
    for away, yaw_rad in ((False, 0.0), (True, math.pi)):
        shut = PoseHypothesis(LIBRARY["wardrobe_two_doors"], 2.5, 0.0, yaw_rad, 0.0, (0.6, 1.0, 1.7))
        costs[away] = prior_cost(shut.with_parameters(open_fraction=1.0), alone) - prior_cost(shut, alone)
    assert costs[False] == pytest.approx(4.0) and costs[True] > costs[False] + 20.0


def test_what_is_built_to_the_millimetre_can_be_built() -> None:
    least = PoseHypothesis(LIBRARY["shelf_open"], 2.0, 0.0, 0.0, 0.0, (0.2197, 0.7, 1.2))
    assert raycaster_of(least) is not None
    with pytest.raises(AssetError, match="x extent is"):
        asset_for(least.as_object())
    assert as_built(least).size_m == (0.22, 0.7, 1.2)
    assert as_built(TABLE) is TABLE


def test_things_are_where_they_are(room: FittedRoom) -> None:
    table, bowl = (thing.fit.guess for thing in room.things)
    assert (table.entry.model, bowl.entry.model) == ("table_four_legs", "porcelain_bowl")
    assert math.dist((table.x_m, table.y_m), (TABLE.x_m, TABLE.y_m)) < 0.01
    assert sorted(table.size_m) == pytest.approx(sorted(TABLE.size_m), abs=0.015)
    assert abs(math.remainder(table.yaw_rad - TABLE.yaw_rad, math.pi / 2)) < 0.01
    assert math.dist((bowl.x_m, bowl.y_m), (BOWL.x_m, BOWL.y_m)) < 0.01
    assert bowl.bottom_m == pytest.approx(0.7, abs=0.005)
    assert all(thing.fit.explained > 0.9 for thing in room.things)


def test_they_make_a_scene_that_stands(room: FittedRoom) -> None:
    _, made = scene_of(room, "drawn")
    assert made.refused == "" and made.scene is not None
    assert "(ontop bowl_0 table_0)" in made.scene.to_json()["facts"]
    assert max(made.settled_m.values()) < 0.005


def painted_around(true: PoseHypothesis) -> tuple[SearchContext, Detection]:
    """Return what is known around a thing that is seen alone, each face in a colour of its own, and its box."""
    body = raycaster_of(true)
    assert body is not None
    observation, boxes = seen_from_above(true)
    _, group = body.render_depth(true, observation.eye_m, observation.rays.reshape(-1, 3))
    palette = np.random.default_rng(1).integers(40, 220, (int(group.max()) + 2, 3)).astype(np.uint8)
    painted = replace(observation, rgb=palette[group].reshape(*observation.z_m.shape, 3))
    down = np.maximum(-observation.rays[..., 2], 1e-6)
    floor_m = np.where(observation.rays[..., 2] < -1e-6, observation.eye_m[2] / down, np.inf)
    nothing = np.zeros(floor_m.shape, dtype=np.int32)
    return SearchContext(painted, floor_m, nothing, nothing.astype(bool), Neighbourhood(())), boxes[0]


@pytest.mark.slow
def test_the_side_with_the_handle_is_the_front_and_tells_the_hinge() -> None:
    true = PoseHypothesis(LIBRARY["cabinet_one_door"], 1.9, 0.0, 0.4, 0.0, (0.6, 0.5, 0.8), (("hinge", "right"),))
    around, box = painted_around(true)
    found = fit_thing(
        around,
        box.box_px,
        [true.entry],
        [0.0],
        points_of(around.observation, box.box_px, around.other_m, around.smaller),
    )
    assert found is not None and dict(found.guess.parameters)["hinge"] == "right"
    assert math.remainder(found.guess.yaw_rad - 0.4, 2 * math.pi) == pytest.approx(0.0, abs=0.03)


def test_nothing_is_carried_across_the_room_to_a_top_as_high_as_its_own() -> None:
    near = replace(TABLE, size_m=(*TABLE.size_m[:2], 0.5))
    far = replace(TABLE, x_m=TABLE.x_m + 3.0, size_m=(*TABLE.size_m[:2], BOWL.bottom_m))
    assert not is_on_one(BOWL, tops_of([near, far]))
    assert is_on_one(BOWL, tops_of([replace(far, x_m=TABLE.x_m)]))
    assert is_on_one(replace(BOWL, bottom_m=0.0), ())
    found, _ = resolve_overlaps({"near": near, "far": far, "bowl": BOWL}, ())
    # It stands on what is below it: what a person has named is not dropped for a support that is as high elsewhere.
    assert found["bowl"] == replace(BOWL, bottom_m=0.5)


def test_what_overlaps_is_taken_apart() -> None:
    wall = Wall(np.array([-1.0, 0.0]), -3.0, (-2.0, 2.0), 2.0, 0.005)
    cabinet = PoseHypothesis(LIBRARY["cabinet_two_doors"], 2.72, 0.0, 0.0, 0.0, (0.6, 0.9, 0.8))
    beside = replace(cabinet, y_m=0.88)
    far = replace(cabinet, x_m=5.0)
    found, notes = resolve_overlaps({"a": cabinet, "b": beside, "c": far}, (wall,))
    assert found["a"].x_m + 0.3 < 3.0
    assert found["a"].y_m + found["a"].size_m[1] / 2 <= found["b"].y_m - found["b"].size_m[1] / 2
    assert found["c"] == far, "what is behind a wall is not in it"
    assert len(notes) == 2
    askew, _ = resolve_overlaps({"a": cabinet, "b": replace(beside, y_m=0.89, yaw_rad=0.06)}, ())
    assert Footprint.of(askew["a"].as_object()).depth_m(Footprint.of(askew["b"].as_object())) <= 0.0


@pytest.mark.parametrize(("hinge", "away"), [("left", 1.0), ("right", -1.0)])
def test_what_stands_beside_a_door_leaves_it_room_to_open(hinge: str, away: float) -> None:
    entry, size_m = LIBRARY["fridge_one_door"], (0.7, 0.6, 1.6)
    fridge = PoseHypothesis(entry, 2.4, 0.0, -0.06 * away, 0.0, size_m).with_parameters(hinge=hinge)
    counter = PoseHypothesis(LIBRARY["counter_plain"], 2.1, away * 0.825, 0.0, 0.0, (0.7, 1.0, 0.9))
    door, shut = swept_parts(fridge.as_object(), math.pi / 2, 30), solid_parts(fridge.as_object())
    before, on_other_side = solid_parts(counter.as_object()), replace(counter, y_m=-counter.y_m)
    assert overlap_depth_m(shut, before) == 0.0 < 0.005 < overlap_depth_m(door, before)
    found, _ = resolve_overlaps({"fridge": fridge, "counter": counter, "other": on_other_side}, ())
    assert (found["fridge"], found["other"]) == (fridge, on_other_side)
    beside = found["counter"]
    assert overlap_depth_m(door, solid_parts(beside.as_object())) < 0.002
    far_side_m = beside.y_m + away * beside.size_m[1] / 2
    assert far_side_m == pytest.approx(away * 1.325) and 0.95 < beside.size_m[1] < 1.0


def test_something_round_stands_at_a_wall_however_it_is_turned() -> None:
    wall = Wall(np.array([-1.0, 0.0]), -3.0, (-2.0, 2.0), 2.0, 0.005)
    table = PoseHypothesis(LIBRARY["table_round"], 2.545, 0.0, 0.7, 0.0, (0.9, 0.9, 0.7))
    assert prior_cost(table, Neighbourhood((wall,))) == prior_cost(replace(table, yaw_rad=0.0), Neighbourhood((wall,)))
    found, _ = resolve_overlaps({"table": table}, (wall,))
    assert found["table"].x_m == pytest.approx(2.545, abs=0.002)


@pytest.mark.slow
def test_what_stands_open_is_looked_for_as_large_as_it_is_without_its_door() -> None:
    fridge = PoseHypothesis(LIBRARY["fridge_one_door"], 2.4, 0.2, 0.3, 0.0, (0.7, 0.6, 1.3), (("open_fraction", 0.6),))
    observation, _ = seen_from_above(fridge)
    out = observation.points_m[(observation.z_m > 0.0) & (observation.z_m < observation.floor_z_m - 0.05)]
    guesses = list(opened_starts(out, [fridge.entry, TABLE.entry], 0.0, ()))
    assert {guess.entry.model for guess in guesses} == {"fridge_one_door"}
    nearest = min(math.hypot(guess.x_m - 2.4, guess.y_m - 0.2) for guess in guesses)
    assert nearest < 0.1 and {dict(guess.parameters)["hinge"] for guess in guesses} == {"left", "right"}


@pytest.mark.parametrize("width_m", [0.075, 0.048])
def test_a_glass_is_looked_for_where_it_is_though_noise_is_as_large_as_it_is(width_m: float) -> None:
    glass = PoseHypothesis(LIBRARY["tumbler"], 2.6, -0.4, 0.0, 0.6, (width_m, width_m, 0.11))
    observation, (box,) = seen_from_above(glass)
    points = observation.points_m[box.pixels(observation.size_px)]
    points = points[np.linalg.norm(points[:, :2] - [2.6, -0.4], axis=1) < 0.2]
    begun = list(starts(points, [glass.entry], 0.6, ()))
    off_m = [max(abs(one.x_m - 2.6), abs(one.y_m + 0.4), abs(one.size_m[1] - width_m)) for one in begun]
    assert min(off_m) < 0.015, "as much as one depth is off by"


def test_nothing_stands_open_into_a_wall() -> None:
    wall = Wall(np.array([-1.0, 0.0]), -3.0, (-2.0, 2.0), 2.0, 0.005)
    fridge = PoseHypothesis(LIBRARY["fridge_one_door"], 2.6, 0.2, math.pi, 0.0, (0.7, 0.6, 1.3))
    opened = fridge.with_parameters(open_fraction=0.5)
    assert 25.0 <= prior_cost(fridge, Neighbourhood((wall,))) < math.inf == prior_cost(opened, Neighbourhood((wall,)))
    assert prior_cost(replace(opened, yaw_rad=0.0), Neighbourhood((wall,))) < 25.0
    beyond = replace(opened, x_m=3.4)
    assert prior_cost(replace(beyond, yaw_rad=0.0), Neighbourhood((wall,))) == math.inf
    assert prior_cost(beyond, Neighbourhood((wall,))) < math.inf, "its back is at the wall that the camera looks over"


def test_a_box_is_the_same_whichever_of_its_sides_is_the_front() -> None:
    cabinet = PoseHypothesis(LIBRARY["cabinet_two_doors"], 2.72, 0.0, 0.0, 0.0, (0.6, 0.9, 0.8))
    turned = replace(cabinet, yaw_rad=-math.pi / 2, size_m=(0.9, 0.61, 0.8))
    assert is_same_box(cabinet, turned) and is_same_box(cabinet, replace(cabinet, yaw_rad=math.pi, x_m=2.71))
    assert not is_same_box(cabinet, replace(cabinet, yaw_rad=math.pi / 2))
    assert not is_same_box(cabinet, replace(cabinet, y_m=0.1)) and not is_same_box(
        cabinet, replace(cabinet, yaw_rad=0.1)
    )


def test_a_wall_is_as_thick_as_what_stands_behind_it_leaves_room_for() -> None:
    wall = Wall(np.array([-1.0, 0.0]), -3.0, (-2.0, 2.0), 2.0, 0.005)
    for x_m, back_m, thick_m in ((2.5, 3.08, 0.08), (3.46, 3.059, 0.059), (3.41, 3.009, 0.02)):
        scene = scene_json(
            {"table": replace(TABLE, x_m=x_m, y_m=0.0, yaw_rad=0.0, size_m=(0.8, 0.6, 0.7))},
            (wall,),
            "seen",
            {"table": "work_bench"},
        )
        assert scene["objects"]["table"]["category"] == "work_bench"  # type: ignore[index]
        made = scene["objects"]["wall_0"]  # type: ignore[index]
        assert made["bbox_extent"][0] == pytest.approx(thick_m, abs=1e-3)
        assert made["position"][0] + made["bbox_extent"][0] / 2 == pytest.approx(back_m, abs=1e-3)
    for seen_m, thick_m in ((0.0, 0.08), (0.12, 0.12)):
        lone = scene_json({}, (replace(wall, thick_m=seen_m),), "seen", {})["objects"]["wall_0"]  # type: ignore[index]
        assert lone["bbox_extent"][0] == pytest.approx(thick_m, abs=1e-3)


@pytest.mark.parametrize(
    ("wall", "starts"),
    [
        (None, True),
        (Wall(np.array([-1.0, 0.0]), -0.3, (-1.0, 1.0), 2.5, 0.005), True),
        (Wall(np.array([0.0, -1.0]), -0.25, (-2.0, 5.0), 2.5, 0.005), False),
    ],
)
def test_the_robot_starts_off_walls_or_wherever_there_is_room(wall: Wall | None, starts: bool) -> None:
    table = replace(TABLE, x_m=2.5, y_m=-0.3, yaw_rad=0.0)
    walls = () if wall is None else (wall,)
    robot = scene_json({"table": table}, walls, "seen", {"table": "table"})["robot"]
    assert ("position" in robot) is starts  # type: ignore[operator]
    made = complete_scene(scene_json({"table": table}, walls, "seen", {"table": "table"}))
    assert made.scene is not None and not [one for one in issues(made.scene) if one.error]
    if starts:
        x_m = robot["position"][0]  # type: ignore[index]
        assert math.copysign(1.0, x_m) == (1.0 if wall is None else -1.0)


@pytest.mark.parametrize(("span_m", "ends_m"), [((-1.7, 1.6), (-1.5, 1.5)), ((-1.5, 1.4), (-1.4, 1.5))])
def test_walls_that_meet_end_at_each_other(span_m: tuple[float, float], ends_m: tuple[float, float]) -> None:
    ahead = Wall(np.array([-1.0, 0.0]), -3.0, span_m, 2.0, 0.005)
    left = Wall(np.array([0.0, -1.0]), -1.5, (-1.0, 2.9), 2.0, 0.005)
    right = Wall(np.array([0.0, 1.0]), -1.5, (-2.9, 1.0), 2.0, 0.005)
    made = scene_json({}, (ahead, left, right), "seen", {})["objects"]["wall_0"]  # type: ignore[index]
    half_m = made["bbox_extent"][1] / 2
    assert (made["position"][1] - half_m, made["position"][1] + half_m) == pytest.approx(ends_m, abs=1e-3)
    beyond = replace(ahead, span_m=(-2.5, 1.5))
    through = scene_json({}, (beyond, left, right), "seen", {})["objects"]["wall_0"]  # type: ignore[index]
    assert through["bbox_extent"][1] == pytest.approx(4.0, abs=1e-3), "it goes on in the next room"
    far = replace(left, span_m=(-9.0, -5.0)), replace(right, span_m=(5.0, 9.0))
    alone = scene_json({}, (ahead, *far), "seen", {})["objects"]["wall_0"]  # type: ignore[index]
    assert alone["bbox_extent"][1] == pytest.approx(ahead.span_m[1] - ahead.span_m[0], abs=1e-3), "they end before it"


def test_a_thing_has_the_colour_that_was_seen() -> None:
    cup = PoseHypothesis(LIBRARY["cup"], 2.1, 0.0, 0.0, 0.0, (0.09, 0.09, 0.10))
    observation, boxes = seen_from_above(cup)
    blue = replace(
        observation,
        rgb=np.where((observation.rgb == COLOURS[1]).all(axis=-1, keepdims=True), COLOURS[2], observation.rgb),
    )
    for picture, word in ((blue, "blue"), (observation, "red")):
        (found,) = reconstruct(picture, boxes, ()).things
        assert dict(found.fit.guess.parameters)["color"] == word
    assert found.fit.colour == COLOURS[1]


def test_the_next_best_models_make_variations_that_stand(room: FittedRoom) -> None:
    (varied,) = variations_of(room, "drawn")
    assert varied.models == {"table_0": "table_round"} and varied.made.refused == ""
    assert varied.made.scene is not None
    assert varied.made.scene.objects["table_0"].model == "table_round"
    assert "(ontop bowl_0 table_0)" in varied.made.scene.to_json()["facts"]


@pytest.mark.slow
def test_without_depth_a_thing_is_where_its_box_and_usual_sizes_put_it_within_what_is_told() -> None:
    observation, boxes = seen_from_above(TABLE)
    flat = replace(observation, z_m=np.zeros_like(observation.z_m), heading_rad=TABLE.yaw_rad)
    (table,) = reconstruct(flat, boxes, (), scale_share=0.02).things
    guess, spread_m = table.fit.guess, table.fit.spread_m
    assert guess.entry.category == "table"
    assert math.dist((guess.x_m, guess.y_m), (TABLE.x_m, TABLE.y_m)) < min(0.3, 2 * spread_m[0])


def test_a_table_stays_askew_beside_a_wall_and_a_cabinet_is_turned_along_it() -> None:
    wall = Wall(np.array([-1.0, 0.0]), -3.0, (-2.0, 2.0), 2.0, 0.005)
    table, cabinet = (
        replace(TABLE, entry=LIBRARY[name], yaw_rad=0.04) for name in ("table_four_legs", "counter_plain")
    )
    found, _ = resolve_overlaps({"table": table, "cabinet": replace(cabinet, y_m=-1.5)}, (wall,))
    assert [round(found[name].yaw_rad, 3) for name in ("table", "cabinet")] == [0.04, 0.0]
