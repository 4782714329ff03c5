"""Level planes of depth, a floor message from a table's top, and what people know of the camera."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from executor.bench.photo.picture_score import angle_deg
from executor.cli.app import run
from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.geometry.observation import (
    USUAL_TOP_M,
    floor_below,
    level_rotation,
    observe,
    planes_below,
    unnamed_top,
)
from executor.photo.geometry.planes import LevelPlane, LevelPlanes, level_planes
from executor.photo.inputs.annotations import Detection, boxes_in
from executor.photo.inputs.depth import Depth, depth_in
from executor.photo.inputs.picture import CameraFacts, Exif, Intrinsics, Photograph, read_facts, up_in_camera
from executor.photo.pipeline import AuxiliaryInputs, read_inputs

SIZE = (320, 240)
CAMERA = Intrinsics(290.0, 290.0, 160.0, 120.0, "drawn")
PICTURE = Photograph(Path("drawn.png"), np.zeros((SIZE[1], SIZE[0], 3), np.uint8), Exif(None, None, ""))
EVERYTHING = (0.0, 0.0, float(SIZE[0]), float(SIZE[1]))


def depth_of(
    up: Array, floor_m: float | None, top_m: float | None = None, growth: float = 0.003, seed: int = 0
) -> Depth:
    """Return the depth of a floor, and of a top that is less far below the camera; a far wall is behind both.

    Args:
        up: (3,) the vertical in the camera's frame.
        floor_m, top_m: How far below the camera; the top fills the left half, or everything if there is no floor.
        growth: Standard deviation of the noise by the square of the depth [1/m].
        seed: Of the noise.
    """
    rays = CAMERA.rays(SIZE)
    down = np.maximum(-(rays @ up), 1e-6)
    z = np.full(down.shape, 6.0) if floor_m is None else np.minimum(floor_m / down, 6.0)
    if top_m is not None:
        over = np.ones(down.shape, dtype=bool) if floor_m is None else np.arange(SIZE[0])[None, :] < SIZE[0] / 2
        # A table ends 1.5 m away.
        z = np.where(over & (top_m / down < 1.5), top_m / down, z)
    noise = np.random.default_rng(seed).normal(size=z.shape)
    return Depth(np.maximum(z + noise * (0.001 + growth * z**2), 0.11), "drawn")


@settings(max_examples=6, deadline=None)
@given(st.floats(10.0, 60.0), st.floats(-12.0, 12.0), st.floats(0.9, 2.0), st.floats(0.3, 0.6), st.integers(0, 99))
def test_the_vertical_and_both_heights_are_those_that_were_drawn(
    tilt_deg: float, roll_deg: float, floor_m: float, top_m: float, seed: int
) -> None:
    up = up_in_camera(tilt_deg, roll_deg)
    found = level_planes(depth_of(up, floor_m, top_m, seed=seed), CAMERA)
    assert found is not None and angle_deg(found.up, up) < 0.3
    assert [one.height_m for one in found.planes] == pytest.approx([floor_m, top_m], abs=0.02)


@pytest.mark.slow
@settings(max_examples=4, deadline=None)
@given(st.floats(20.0, 60.0), st.floats(-10.0, 10.0), st.floats(0.25, 0.7))
def test_a_top_that_fills_the_picture_is_a_table_of_usual_height(
    tilt_deg: float, roll_deg: float, top_m: float
) -> None:
    depth, up = depth_of(up_in_camera(tilt_deg, roll_deg), None, top_m), up_in_camera(tilt_deg, roll_deg)
    seen, floor = observe(PICTURE, depth, CAMERA)
    assert angle_deg(floor.up, up) < 0.3
    assert floor.above_top_m == pytest.approx(top_m, abs=0.02)
    assert floor.height_m == pytest.approx(top_m + USUAL_TOP_M, abs=0.02) and floor.visible_m2 == 0.0
    assert floor.source.startswith("assumed") and floor.to_json()["camera_above_top_m"] == floor.above_top_m
    assert seen.noise.growth_per_m == pytest.approx(0.003, abs=0.0015)
    # The top is there for what stands on it, also where nobody has put a box around the table.
    top = unnamed_top(level_planes(depth, CAMERA), floor, ())
    assert top is not None and top.category == "table" and top.provenance == "detector"


def test_the_box_of_a_table_decides_where_its_top_is_as_far_down_as_a_floor() -> None:
    found = level_planes(depth_of(up_in_camera(35.0, 0.0), None, 0.9), CAMERA)
    assert floor_below("p", found).above_top_m is None
    counter = Detection("kitchen counter", "countertop", EVERYTHING, 1.0, "me")
    below = floor_below("p", found, [counter])
    assert below.above_top_m == pytest.approx(0.9, abs=0.02) and "kitchen counter" in below.source
    assert unnamed_top(found, below, [counter]) is None
    # A box around something else, or around a part, is no such evidence.
    for other in (replace(counter, category="sofa"), replace(counter, box_px=(0.0, 0.0, 100.0, 240.0))):
        assert floor_below("p", found, [other]).above_top_m is None


def test_a_floor_below_a_table_is_the_floor_though_the_tables_box_is_around_both() -> None:
    found = level_planes(depth_of(up_in_camera(35.0, 0.0), 1.4, 0.66), CAMERA)
    floor = floor_below("p", found, [Detection("desk", "desk", EVERYTHING, 1.0, "me")])
    assert floor.height_m == pytest.approx(1.4, abs=0.02) and floor.above_top_m is None and floor.visible_m2 > 0.2


@pytest.mark.parametrize(("given_m", "height_m"), [(None, 1.3), (0.72, 0.7), (1.6, 1.6)])
def test_a_given_height_decides_also_where_a_small_floor_is_visible(given_m: float | None, height_m: float) -> None:
    u, v = np.meshgrid(np.arange(100, 300, 4), np.arange(100, 300, 4))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    top, low = LevelPlane(0.7, 0.8, 0.003, pixels), LevelPlane(1.3, 0.05, 0.003, pixels[:50] + 300)
    found = LevelPlanes(np.array([0.0, 0.0, 1.0]), (low, top))
    can = Detection("can", "can", (90.0, 90.0, 310.0, 310.0), 1.0, "drawn")
    floor = floor_below("p", found, [can], CameraFacts(height_m=given_m))
    assert floor.height_m == pytest.approx(height_m)


def test_a_given_height_decides_and_a_given_tilt_stands_where_nothing_level_is_measured() -> None:
    found = level_planes(depth_of(up_in_camera(35.0, 0.0), None, 0.6), CAMERA)
    given_floor = floor_below("p", found, (), CameraFacts(height_m=1.3))
    assert given_floor.height_m == 1.3 and given_floor.above_top_m == pytest.approx(0.6, abs=0.02)
    nearly = floor_below("p", found, (), CameraFacts(height_m=0.62))
    assert nearly.height_m == pytest.approx(0.6, abs=0.02) and nearly.above_top_m is None
    wall = Depth(np.full((SIZE[1], SIZE[0]), 2.0), "a wall straight ahead")
    assert level_planes(wall, CAMERA) is None
    with pytest.raises(PhotoRefused, match="nothing level is below") as caught:
        floor_below("p", None, (), CameraFacts(tilt_deg=10.0))
    assert caught.value.kind == "floor"
    alone = floor_below("p", None, (), CameraFacts(10.0, 2.0, 1.5))
    assert alone.height_m == 1.5 and alone.tilt_deg == pytest.approx(10.0) and "given" in alone.source
    with pytest.raises(PhotoRefused, match="expected at most 3 m"):
        floor_below("p", level_planes(depth_of(up_in_camera(60.0, 0.0), 3.5), CAMERA))


def corner_of(up: Array, top_m: float, growth: float, seed: int = 0) -> Depth:
    """Return the depth of two walls that meet, and of a narrow top at 1.6 to 2.1 m between them."""
    ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
    ahead /= np.linalg.norm(ahead)
    aside = np.cross(ahead, up)
    rays = CAMERA.rays(SIZE)
    z = np.full(rays.shape[:2], 9.0)
    for normal, off_m in ((ahead + 0.6 * aside, 2.6), (ahead - aside / 0.6, 3.4)):
        facing = rays @ (normal / np.linalg.norm(normal))
        z = np.where(facing > 1e-6, np.minimum(z, off_m / np.maximum(facing, 1e-6)), z)
    level = top_m / np.maximum(-(rays @ up), 1e-6)
    z = np.where((level > 1.6) & (level < 2.1) & (np.abs(rays[..., 0]) < 0.25), level, z)
    noise = np.random.default_rng(seed).normal(size=z.shape)
    return Depth(np.maximum(z + noise * (0.001 + growth * z**2), 0.11), "drawn")


@pytest.mark.parametrize("roll_deg", [0.0, 6.0])
def test_walls_level_a_noisy_picture_with_little_that_is_level(roll_deg: float) -> None:
    up = up_in_camera(8.0, roll_deg)
    found = level_planes(corner_of(up, 0.5, 0.008), CAMERA)
    assert found is not None and angle_deg(found.up, up) < 1.5
    assert found.planes[0].height_m == pytest.approx(0.5, abs=0.05)
    # Walls alone are no floor.
    assert level_planes(corner_of(up, 9.0, 0.008), CAMERA) is None


CARRIED = [Detection("can", "can", (x, 100.0, x + 40.0, 150.0), 1.0, "me") for x in (60.0, 160.0)]


@pytest.mark.parametrize(("tilt_deg", "roll_deg"), [(84.0, 0.0), (80.0, 45.0), (65.0, 178.0)])
def test_a_boxed_table_that_carries_things_levels_a_camera_that_is_turned(tilt_deg: float, roll_deg: float) -> None:
    up = up_in_camera(tilt_deg, roll_deg)
    depth = depth_of(up, None, 0.6)
    upright = level_planes(depth, CAMERA)
    table = Detection("table", "table", EVERYTHING, 1.0, "me")
    found = planes_below(upright, depth, CAMERA, [table, *CARRIED])
    assert found is not None and angle_deg(found.up, up) < 0.5
    assert floor_below("p", found, [table]).above_top_m == pytest.approx(0.6, abs=0.02)
    # A box around something else, and one that carries nothing, may show a wall.
    for things in ([replace(table, category="wardrobe"), *CARRIED], [table, CARRIED[0]]):
        assert planes_below(upright, depth, CAMERA, things) is upright
    given_up = level_planes(depth, CAMERA, up)
    assert given_up is not None and angle_deg(given_up.up, up) < 0.5


def test_a_plane_near_below_the_camera_is_the_floor_where_furniture_stands_and_nothing_is_lower() -> None:
    low = level_planes(depth_of(up_in_camera(10.0, 0.0), 0.2), CAMERA)
    chair = Detection("chair", "chair", (200.0, 0.0, 300.0, 200.0), 1.0, "me")
    assert floor_below("p", low, [chair]).height_m == pytest.approx(0.2, abs=0.02)
    assert floor_below("p", low, [replace(chair, category="mug")]).above_top_m is not None
    assert low is not None
    assert floor_below("p", replace(low, deepest_m=0.9), [chair]).above_top_m is not None


def test_a_plane_that_ends_at_a_wall_is_the_floor_where_a_person_boxed_no_table() -> None:
    up = up_in_camera(25.0, 2.0)
    ahead = CAMERA.rays(SIZE) @ level_rotation(up).T
    low = depth_of(up, 0.5)
    walled = replace(low, z_m=np.minimum(low.z_m, 1.1 / np.maximum(ahead[..., 0], 0.05)))
    mug = Detection("mug", "mug", (200.0, 100.0, 240.0, 140.0), 1.0, "me")
    found = level_planes(walled, CAMERA)
    assert found is not None and angle_deg(found.up, up) < 0.5
    floor = floor_below("p", found, [mug])
    assert floor.above_top_m is None and floor.height_m == pytest.approx(0.5, abs=0.02)
    # Near misses: a network may miss a table, a table has its box, something is lower, there is no wall.
    table = Detection("table", "table", EVERYTHING, 1.0, "me")
    for things in ([replace(mug, provenance="detector")], [mug, table], ()):
        assert floor_below("p", found, things).above_top_m == pytest.approx(0.5, abs=0.02)
    for other in (replace(found, deepest_m=0.9), level_planes(depth_of(up, None, 0.5), CAMERA)):
        assert floor_below("p", other, [mug]).above_top_m is not None


def test_a_wall_is_across_the_picture_where_most_columns_show_it_down_to_the_floor() -> None:
    up = up_in_camera(25.0, 2.0)
    ahead = CAMERA.rays(SIZE) @ level_rotation(up).T
    low = depth_of(up, 0.5)
    wall_m = 1.1 / np.maximum(ahead[..., 0], 0.05)
    column = np.broadcast_to(np.arange(SIZE[0]), low.z_m.shape)
    # The floor goes on in a doorway that nothing is measured in.
    for door, is_walled in (((150, 165), True), ((20, 300), False)):
        inside = (column > door[0]) & (column < door[1])
        z_m = np.where(low.z_m < wall_m, low.z_m, np.where(inside, 0.0, wall_m))
        found = level_planes(replace(low, z_m=z_m), CAMERA)
        assert found is not None and found.is_walled is is_walled
    # A table's top before a wall that goes on below it.
    table = np.where(ahead[..., 0] * low.z_m < 0.8, low.z_m, wall_m)
    found = level_planes(replace(low, z_m=table), CAMERA)
    assert found is not None and found.planes[0].height_m == pytest.approx(0.5, abs=0.02) and not found.is_walled


def test_the_front_of_a_cabinet_is_no_top_though_things_that_are_on_it_are_in_its_box() -> None:
    up = up_in_camera(14.0, 4.0)
    ahead = CAMERA.rays(SIZE) @ level_rotation(up).T
    far_m = 1.0 / np.maximum(ahead[..., 0], 0.05), 1.14 / np.maximum(ahead[..., 0], 0.05)
    top = np.where(ahead[..., 2] < -0.05, 0.35 / np.maximum(-ahead[..., 2], 0.05), 9.0)
    z = np.where(-ahead[..., 2] * far_m[0] > 0.35, far_m[0], np.minimum(top, far_m[1]))
    noise = np.random.default_rng(0).normal(size=z.shape)
    depth = Depth(z + noise * (0.001 + 0.002 * z**2), "drawn")
    row = float(np.argmax(z[:, 160] == far_m[0][:, 160]))
    cabinet = Detection("cabinet", "bottom_cabinet", (0.0, row - 25.0, 320.0, 240.0), 1.0, "me")
    remotes = [Detection("remote", None, (x, row - 20.0, x + 40.0, row - 8.0), 1.0, "me") for x in (60.0, 160.0)]
    found = planes_below(level_planes(depth, CAMERA), depth, CAMERA, [cabinet, *remotes])
    assert found is not None and angle_deg(found.up, up) < 3.0
    assert floor_below("p", found, [cabinet]).above_top_m == pytest.approx(0.35, abs=0.06)


def test_a_bed_that_fills_the_picture_is_as_high_as_beds_are() -> None:
    found = level_planes(depth_of(up_in_camera(35.0, 0.0), None, 0.7), CAMERA)
    bed = Detection("bed", "bed", EVERYTHING, 1.0, "me")
    floor = floor_below("p", found, [bed])
    assert floor.height_m == pytest.approx(1.2, abs=0.02) and unnamed_top(found, floor, [bed]) is None
    # As far down as a floor, it is one.
    far = level_planes(depth_of(up_in_camera(35.0, 0.0), None, 0.9), CAMERA)
    assert floor_below("p", far, [bed]).above_top_m is None


def test_of_two_slopes_the_one_near_the_given_tilt_is_level() -> None:
    # A board that leans by 25 degrees fills most of the picture.
    up, board = up_in_camera(30.0, 0.0), up_in_camera(55.0, 0.0)
    floor, leaning = depth_of(up, 1.4), depth_of(board, 1.1)
    z_m = np.where(np.arange(SIZE[0])[None, :] < 110, floor.z_m, leaning.z_m)
    both = Depth(z_m, "drawn")
    free, near = level_planes(both, CAMERA), level_planes(both, CAMERA, up_in_camera(33.0, 2.0))
    assert free is not None and angle_deg(free.up, board) < 1.0
    assert near is not None and angle_deg(near.up, up) < 1.0


def test_facts_are_typed_or_in_the_camera_file_and_typed_ones_count(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({"fx": 1, "tilt_deg": 20, "roll_deg": 1, "height_m": 1.2, "depth_kind": "guessed"}))
    assert read_facts(str(path), CameraFacts()) == CameraFacts(20, 1, 1.2, "guessed")
    assert read_facts(str(path), CameraFacts(tilt_deg=25.0)) == CameraFacts(25.0, 1, 1.2, "guessed")
    assert read_facts("hfov=60", CameraFacts(height_m=1.0)) == CameraFacts(height_m=1.0)
    assert read_facts(None, CameraFacts(89.0, 175.0, 0.13)).up is not None
    for wrong in ({"tilt_deg": 120}, {"height_m": "high"}, {"depth_kind": "felt"}, {"roll_deg": 3}, {"tilt_deg": None}):
        path.write_text(json.dumps(wrong))
        with pytest.raises(PhotoRefused) as caught:
            read_facts(str(path), CameraFacts())
        assert caught.value.kind == "camera"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    noise = np.random.default_rng(0).integers(0, 255, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
    Image.fromarray(noise).save("bare.jpg")
    np.save("depth.npy", depth_of(up_in_camera(30.0, 0.0), 1.4).z_m)
    things = [{"label": "chair", "box": [40, 60, 120, 200]}]
    Path("boxes.json").write_text(json.dumps({"source": "me", "things": things}))
    return tmp_path


def test_a_given_tilt_and_height_level_a_picture_without_depth(folder: Path) -> None:
    detect = boxes_in(folder / "boxes.json", "bare.jpg")
    facts = CameraFacts(20.0, 3.0, 1.5)
    made = read_inputs(folder / "bare.jpg", AuxiliaryInputs(detect, camera="hfov=60", facts=facts))
    assert made.floor.up == pytest.approx(up_in_camera(20.0, 3.0)) and made.floor.height_m == 1.5
    assert "tilt as given" in made.floor.source and not made.observation.has_depth
    other = read_inputs(
        folder / "bare.jpg", AuxiliaryInputs(detect, camera="hfov=60", facts=replace(facts, tilt_deg=21.0))
    )
    assert made.sha256 != other.sha256


def test_a_depth_file_can_be_a_guess(folder: Path) -> None:
    detect = boxes_in(folder / "boxes.json", "bare.jpg")
    measured = AuxiliaryInputs(detect, depth_in(folder / "depth.npy", None), "hfov=58")
    guessed = replace(measured, facts=CameraFacts(depth_kind="guessed"))
    first, second = read_inputs(folder / "bare.jpg", measured), read_inputs(folder / "bare.jpg", guessed)
    assert first.observation.depth_distortion == 0.0 < second.observation.depth_distortion
    assert second.depth is not None and "guessed" in second.depth.source
    assert first.sha256 != second.sha256


def test_without_depth_a_picture_is_upright(folder: Path) -> None:
    detect = boxes_in(folder / "boxes.json", "bare.jpg")
    with pytest.raises(PhotoRefused, match="turn the picture") as caught:
        read_inputs(folder / "bare.jpg", AuxiliaryInputs(detect, camera="hfov=60", facts=CameraFacts(20.0, 90.0, 1.5)))
    assert caught.value.kind == "camera"


MISSING = {
    (): ("--boxes", "--camera hfov=", "--tilt", "--camera-height-m"),
    ("--camera", "hfov=60"): ("--boxes", "--tilt", "--camera-height-m"),
    ("--camera", "hfov=60", "--boxes", "boxes.json"): ("--tilt", "--camera-height-m"),
    ("--camera", "hfov=60", "--boxes", "boxes.json", "--camera-height-m", "1.5"): ("--tilt",),
    ("--boxes", "boxes.json", "--tilt", "20", "--camera-height-m", "1.5"): ("--camera hfov=",),
    ("--depth", "depth.npy"): ("--boxes", "--camera hfov="),
}


@pytest.mark.parametrize("words", MISSING, ids=" ".join)
def test_one_message_has_everything_that_is_missing(
    folder: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    assert run(["photo", "bare.jpg", *words, "--out", "out"]) == 2
    message = " ".join(capsys.readouterr().err.split())
    options = ("--boxes", "--camera hfov=", "--tilt", "--camera-height-m")
    assert message.startswith("scene2demo: bare.jpg: ") and "Traceback" not in message
    asked = message.split("command is: " if not words else "; add ")[-1].split(" (--depth")[0]
    assert [one for one in options if one in asked] == list(MISSING[words])
    assert not (folder / "out").exists()


def corner(up: Array, turns_deg: tuple[float, ...], seed: int = 0) -> Depth:
    """Return the depth of walls 2.5 m away in some directions from straight ahead, that reach beyond the picture."""
    R = level_rotation(up)
    rays = CAMERA.rays(SIZE) @ R.T
    z = np.full(rays.shape[:2], 20.0)
    for turn in np.radians(turns_deg):
        away = rays[..., :2] @ [np.cos(turn), np.sin(turn)]
        z = np.where(away > 0.05, np.minimum(z, 2.5 / np.maximum(away, 0.05)), z)
    noise = np.random.default_rng(seed).normal(size=z.shape)
    return Depth(z + noise * (0.001 + 0.002 * z**2), "drawn")


DRESSER_PX = (60.0, 140.0, 260.0, 240.0)
ON_IT_PX = ((80.0, 130.0, 100.0, 165.0), (150.0, 125.0, 170.0, 168.0), (200.0, 140.0, 225.0, 170.0))


def with_things(depth: Depth, up: Array, top_m: float) -> Depth:
    """Return a depth in which three boxes end on a level top so far below the camera."""
    z = depth.z_m.copy()
    slope = -(CAMERA.rays(SIZE) @ up)
    for x0, _, x1, y1 in ON_IT_PX:
        rows = np.s_[int(y1) - 4 : int(y1) + 4, int(x0) : int(x1)]
        z[rows] = top_m / slope[rows]
    return replace(depth, z_m=z)


@pytest.mark.parametrize("roll_deg", [0.0, 3.6, -8.0])
def test_where_only_two_walls_are_seen_they_give_the_vertical_and_things_their_support(roll_deg: float) -> None:
    up = up_in_camera(-1.0, roll_deg)
    depth = with_things(corner(up, (-40.0, 50.0)), up, 0.3)
    things = [Detection("dresser", "bottom_cabinet", DRESSER_PX, 1.0, "me")]
    things += [Detection("can", "can", box, 1.0, "me") for box in ON_IT_PX]
    found = planes_below(level_planes(depth, CAMERA), depth, CAMERA, things)
    assert found is not None and angle_deg(found.up, up) < 1.0
    floor = floor_below("drawn.png", found, things)
    assert floor.above_top_m == pytest.approx(0.3, abs=0.03) and floor.height_m > 0.9
    assert "assumed" in floor.source and "no floor is visible" in floor.source
    # Near misses: nothing says how high anything is; one wall, which may be turned about its normal.
    for others in (things[1:], things[:2]):
        assert planes_below(None, depth, CAMERA, others) is None
    one_wall = with_things(corner(up, (5.0,)), up, 0.3)
    assert planes_below(None, one_wall, CAMERA, things) is None
