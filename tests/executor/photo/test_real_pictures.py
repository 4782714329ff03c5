"""The benchmark of real pictures: its scores against counting by hand, and two tiny pictures that go the whole way."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from executor.assets.library import LIBRARY
from executor.bench.photo.picture_score import (
    angle_deg,
    causes,
    extents_m,
    is_called,
    is_same_support,
    level_scores,
    outline_iou,
    picture_rows,
    pixels_of_box,
    plane_of,
    points_in_camera,
    sections,
    size_scores,
    within,
)
from executor.bench.photo.pictures import OutOfTime, cpu_limit, measure_pictures, reached, read_pictures
from executor.cli.app import run
from executor.geometry import Array, rotation_z
from executor.photo.drawing import visible_surfaces
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.geometry.level import flat_observation
from executor.photo.geometry.observation import FloorPlane
from executor.photo.geometry.residuals import box_of
from executor.photo.inputs.picture import Exif, Intrinsics, Photograph, up_in_camera
from executor.records import Rollout
from executor.scenes import library
from executor.sim.world import World

CAMERA = Intrinsics(200.0, 200.0, 80.0, 60.0, "test")
SIZE = (120, 160)
SIDES = st.integers(0, 11).flatmap(lambda low: st.tuples(st.just(low), st.integers(low + 1, 12)))
CORNERS = st.builds(lambda x, y: (x[0], y[0], x[1], y[1]), SIDES, SIDES)


@given(CORNERS, CORNERS)
def test_the_outline_iou_is_that_of_counted_pixels(made: tuple[int, ...], true: tuple[int, ...]) -> None:
    def pixels(box: tuple[int, ...]) -> set[tuple[int, int]]:
        return set(product(range(box[0], box[2]), range(box[1], box[3])))

    mask = within((12, 12), (float(made[0]), float(made[1]), float(made[2]), float(made[3])))
    assert {(int(x), int(y)) for y, x in np.argwhere(mask)} == pixels(made)
    share = len(pixels(made) & pixels(true)) / len(pixels(made) | pixels(true))
    assert outline_iou(mask, (true[0], true[1], true[2], true[3])) == pytest.approx(share)


def test_nothing_visible_has_no_outline() -> None:
    assert outline_iou(np.zeros((4, 4), dtype=bool), (0.0, 0.0, 4.0, 4.0)) == 0.0


@given(st.floats(-80.0, 80.0), st.floats(-40.0, 40.0))
def test_the_vertical_is_that_of_a_turned_camera(tilt_deg: float, roll_deg: float) -> None:
    tilt, roll = math.radians(tilt_deg), math.radians(roll_deg)
    # A level camera is tilted about its own x axis, then turned about its line of sight.
    about_x = np.array([[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]])
    turned = rotation_z(roll) @ (about_x @ np.array([0.0, -1.0, 0.0]))
    assert up_in_camera(tilt_deg, roll_deg) == pytest.approx(turned, abs=1e-9)
    scores = level_scores({"tilt_deg": tilt_deg, "roll_deg": roll_deg, "height_m": 1.5}, turned, 1.4)
    assert scores["off_deg"] == pytest.approx(0.0, abs=1e-5)
    assert scores["tilt_off_deg"] == pytest.approx(0.0, abs=1e-5)
    assert scores["height_off_m"] == pytest.approx(-0.1)


def test_a_top_is_known_from_the_floor() -> None:
    level, up = {"height_m": 1.5, "height_above_support_m": 0.7}, up_in_camera(20.0, 0.0)
    assert (
        level_scores(level, up, 0.72)["took_top_for_floor"] and not level_scores(level, up, 1.4)["took_top_for_floor"]
    )
    assert level_scores({"height_above_support_m": 0.7}, up, 0.72)["took_top_for_floor"]
    assert not level_scores({"height_above_support_m": 0.7}, up, 1.4)["took_top_for_floor"]
    assert angle_deg(up, up_in_camera(23.0, 0.0)) == pytest.approx(3.0)


def test_a_name_is_a_person_s_word_or_another_one_for_the_same() -> None:
    assert is_called("mug", "mug") and is_called("Night table", "nightstand") and is_called("mug", "coffee_mug")
    assert not is_called("mug", "medicine_bottle") and not is_called("bed", "chair") and not is_called("ottoman", "bed")


def block_before_a_wall(near_m: float, high_m: float) -> tuple[Array, tuple[float, float, float, float]]:
    """A block (0.2 m wide) in front of a wall at 2 m, and a box that is larger than it."""
    z_m = np.full(SIZE, 2.0)
    wide, high = 0.2 / near_m * CAMERA.fx, high_m / near_m * CAMERA.fy
    box = (80 - wide / 2, 60 - high / 2, 80 + wide / 2, 60 + high / 2)
    z_m[within(SIZE, box)] = near_m
    return z_m, (box[0] - 5, box[1] - 5, box[2] + 5, box[3] + 5)


def test_a_thing_is_as_wide_as_its_depth() -> None:
    z_m, box = block_before_a_wall(1.0, 0.3)
    own = pixels_of_box(z_m, CAMERA, box, [])
    assert (own == (z_m == 1.0)).all()
    # Brute force: sorted coordinates without a twentieth on either side.
    points = points_in_camera(z_m, CAMERA)[own]
    counted = [sorted(points[:, axis]) for axis in (0, 1)]
    sides = [one[round(0.95 * (len(one) - 1))] - one[round(0.05 * (len(one) - 1))] for one in counted]
    assert extents_m(points) == pytest.approx(sides, abs=0.002)
    nearer_z_m, _ = block_before_a_wall(0.9, 0.15)
    ratios, nearer_m = size_scores(own, z_m, nearer_z_m == 0.9, nearer_z_m, CAMERA, box)
    assert ratios == pytest.approx((1.0, 0.5), abs=0.03) and nearer_m == pytest.approx(0.1)
    assert size_scores(own, z_m, np.zeros(SIZE, dtype=bool), nearer_z_m, CAMERA, box) == (None, None)


def test_what_is_before_a_thing_is_not_of_it() -> None:
    z_m, box = block_before_a_wall(1.0, 0.3)
    z_m[within(SIZE, (70.0, 50.0, 90.0, 70.0))] = 0.99
    own = pixels_of_box(z_m, CAMERA, box, [(70.0, 50.0, 90.0, 70.0)])
    assert (own == (z_m == 1.0)).all()


def test_a_plane_is_found_among_other_points() -> None:
    rng = np.random.default_rng(3)
    flat = np.column_stack([rng.uniform(-1, 1, (300, 2)), rng.normal(0.5, 0.002, 300)])
    plane = plane_of(np.vstack([flat, rng.uniform(-1, 1, (150, 3))]))
    assert plane is not None and abs(plane[0][2]) > 0.999 and abs(plane[1]) == pytest.approx(0.5, abs=0.01)
    assert plane_of(rng.uniform(-1, 1, (300, 3))) is None and plane_of(flat[:10]) is None


THING = {"made": "", "lost": "x 1.5 cm", "named": False, "outline_iou": 0.0, "support": "on a", "support_right": False}
THING |= {"size_ratios": None, "nearer_m": None}
CHAIN = {"possible": True, "planned": True, "feasible": True, "succeeded": False, "as_asked": False, "scaled": {}}
CHAIN |= {"stage": "execution: slipped"}
PICTURE = {"half": "tuning", "has_depth": True, "refused": "", "refused_kind": "", "refused_as_given": ""}
PICTURE |= {"refused_as_given_kind": "", "level": None, "invented": [], "cpu_s": 10.0, "things": [], "sentences": []}


@settings(max_examples=30)
@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.booleans()), max_size=12))
def test_the_table_counts_what_was_lost(drawn: list[tuple[bool, bool, bool]]) -> None:
    things = [
        {**THING, "made": "t" * kept, "named": kept and named, "outline_iou": 0.5 * kept, "support_right": kept and on}
        for kept, named, on in drawn
    ]
    rows = dict(picture_rows([{**PICTURE, "things": things}]))
    named, on = (sum(kept and one[place] for kept, *one in drawn) for place in (0, 1))
    if drawn:
        assert rows["labels kept"].startswith(f"{named} of {len(drawn)},")
        assert rows["support right"].startswith(f"{on} of {len(drawn)},")
        middle = float(np.median([0.5 * kept for kept, _, _ in drawn]))
        assert rows["outline IoU, lost count 0"].startswith(f"median {middle:.2f}")
    else:
        assert rows["labels kept"] == rows["outline IoU, lost count 0"] == "none"


def test_what_is_in_a_shelf_is_on_one_of_its_boards() -> None:
    assert is_same_support("inside shelf", "on shelf", {"shelf"}) and is_same_support("on desk", "on desk", ())
    assert not is_same_support("inside bowl", "on bowl", {"shelf"})
    assert not is_same_support("on shelf", "inside shelf", {"shelf"})
    assert not is_same_support("inside shelf", "on shelf_2", {"shelf", "shelf_2"})


def test_causes_and_sections_are_counted() -> None:
    chains = [CHAIN, {**CHAIN, "possible": False}, {**CHAIN, "succeeded": True, "as_asked": True, "scaled": {"m": 0.6}}]
    lost = {**PICTURE, "refused": "no floor", "refused_kind": "floor", "half": "judging", "has_depth": False}
    done = [{**PICTURE, "things": [THING, {**THING, "lost": "x 2 cm"}], "sentences": chains}, lost]
    assert list(sections(done)) == ["tuning, with depth", "judging, without depth"]
    found = causes(done)
    assert found["pictures"] == {"floor": 1} and found["boxes"] == {"x 1.5 cm": 1, "x 2 cm": 1}
    assert found["possible sentences"] == {"execution: slipped": 1}
    rows = dict(picture_rows(done))
    assert rows["  of all, as asked"].startswith("1 of 2,")
    assert rows["  of all, as asked and nothing scaled"].startswith("0 of 2,")
    assert rows["impossible sentences: not reached"].startswith("1 of 1,")
    assert rows["a scene to work in"].startswith("1 of 2,")


def test_a_picture_ends_with_its_time() -> None:
    with pytest.raises(OutOfTime), cpu_limit(0.05):
        while True:
            pass
    with pytest.raises(OutOfTime), cpu_limit(0.0):
        pass
    with cpu_limit(5.0):
        pass


INDEX = """
[[pictures]]
id = "tiny_desk"
half = "tuning"
color = {{ path = "a/rgb.png" }}
depth = {{ path = "a/d.png", unit_m = 0.0005 }}
level = {{ height_m = 1.3, tilt_deg = {tilt:.3f}, roll_deg = 0.0 }}

[[pictures]]
id = "blank"
half = "tuning"
color = {{ path = "b/rgb.png" }}
level = {{ height_m = 1.2, tilt_deg = 20.0 }}
"""


TINY_SIZE, TINY_CAMERA = (72, 96), Intrinsics(120.0, 120.0, 48.0, 36.0, "test")


def write_tiny(folder: Path) -> None:
    """Two pictures of 96 x 72: a table with a mug, drawn with its depth, and one in which nothing is to be seen."""
    tilt_deg = 30.0
    picture = Photograph(folder / "tiny", np.full((*TINY_SIZE, 3), 90, dtype=np.uint8), Exif(None, None, ""))
    floor = FloorPlane(up_in_camera(tilt_deg, 0.0), 1.3, 1.0, tilt_deg, 0.0)
    seen = flat_observation(picture, TINY_CAMERA, floor)
    table = PoseHypothesis(LIBRARY["table_four_legs"], 1.6, 0.0, 0.0, 0.0, (0.7, 1.1, 0.7))
    mug = PoseHypothesis(LIBRARY["mug"], 1.5, 0.1, 0.5, 0.7, (0.12, 0.09, 0.10))
    owner, z_m = visible_surfaces(seen, {"table": table, "mug": mug})
    z_m = np.minimum(z_m, seen.floor_z_m)
    z_m[~np.isfinite(z_m) | (z_m > 8.0)] = 0.0
    rgb = np.stack([np.choose(owner + 1, (shade, 150, 40)) for shade in (110, 105, 100)], axis=-1).astype(np.uint8)
    Image.fromarray(rgb).save(folder / "tiny_desk.png")
    Image.fromarray(np.round(z_m / 0.0005).astype(np.uint16)).save(folder / "tiny_desk_depth.png")
    Image.fromarray(np.full((*TINY_SIZE, 3), 128, dtype=np.uint8)).save(folder / "blank.png")
    camera = json.dumps({"fx": TINY_CAMERA.fx, "fy": TINY_CAMERA.fy, "cx": TINY_CAMERA.cx, "cy": TINY_CAMERA.cy})
    (folder / "tiny_desk_camera.json").write_text(camera)
    (folder / "blank_camera.json").write_text(camera)
    boxes = [box_of(owner == number) for number in (0, 1)]
    things: list[dict[str, Any]] = [
        {"id": "desk", "label": "table", "box": boxes[0], "on": "floor"},
        {"id": "cup", "label": "mug", "box": boxes[1], "on": "desk"},
        {"id": "what", "label": "gramophone", "box": [0, 0, 20, 20], "on": "floor"},
    ]
    sentences: list[dict[str, Any]] = [
        {"sentence": "pick up the mug", "goals": [["(not (ontop cup desk))"]], "possible": True},
        {"sentence": "pick up the gramophone", "goals": [["(not (ontop what desk))"]], "possible": False},
    ]
    told = {"source": "drawn", "size_px": [96, 72]}
    (folder / "annotations").mkdir()
    (folder / "annotations" / "tiny_desk.json").write_text(
        json.dumps({**told, "things": things, "sentences": sentences})
    )
    blank = {**told, "things": [{"id": "bed", "label": "bed", "box": [20, 20, 80, 60], "on": "floor"}]}
    blank["sentences"] = [{"sentence": "go to the bed", "goals": [["(ontop bed bed)"]], "possible": True}]
    (folder / "annotations" / "blank.json").write_text(json.dumps(blank))
    (folder / "pictures.toml").write_text(INDEX.format(tilt=tilt_deg))


@pytest.mark.slow
@pytest.mark.physics
def test_two_tiny_pictures_go_the_whole_way(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_tiny(tmp_path)
    out = tmp_path / "out"
    given = ["--pictures", str(tmp_path), "--annotations", str(tmp_path), "--out", str(out)]
    assert run(["bench", "photo", *given, "--json"]) == 0
    card = json.loads(capsys.readouterr().out)["sections"]
    desk = json.loads((out / "picture-tiny_desk.json").read_text())
    assert desk["refused"] == "" and desk["invented"] == []
    assert (out / "tiny_desk" / "overlay.png").is_file() and (out / "tiny_desk" / "scene.json").is_file()
    table, mug, gramophone = desk["things"]
    assert (table["named"], mug["named"], gramophone["named"]) == (True, True, True)
    assert table["stands"] == "on floor" and mug["stands"] == "on desk" and mug["support_right"]
    assert table["outline_iou"] > 0.9 and mug["outline_iou"] > 0.7
    assert table["size_ratios"] == pytest.approx((1.0, 1.0), abs=0.1) and abs(mug["nearer_m"]) < 0.02
    assert desk["level"]["off_deg"] < 1.0 and abs(desk["level"]["height_off_m"]) < 0.02
    picked, unknown = desk["sentences"]
    assert picked["planned"] and picked["succeeded"] and picked["as_asked"] and picked["stage"] == ""
    assert not unknown["as_asked"]
    blank = json.loads((out / "picture-blank.json").read_text())
    # Tilt and height are given, and a box that a person drew is evidence enough.
    assert blank["refused"] == "" and blank["things"][0]["named"] and blank["things"][0]["outline_iou"] > 0.7
    assert not blank["sentences"][0]["as_asked"]
    assert card["tuning, with depth"]["card"]["labels kept"].startswith("3 of 3,")
    assert card["tuning, without depth"]["card"]["labels kept"].startswith("1 of 1,")
    # Each is measured once.
    before = {path.name: path.stat().st_mtime_ns for path in out.glob("picture-*.json")}
    assert run(["bench", "photo", *given]) == 0
    assert "labels kept" in capsys.readouterr().out
    assert {path.name: path.stat().st_mtime_ns for path in out.glob("picture-*.json")} == before


def test_a_goal_is_reached_by_the_robot_or_not_at_all() -> None:
    scene = library.load("kitchen_t1")
    glass, table = scene.objects["glass_0"], scene.objects["table_0"]
    made, ids = {"cup": "glass_0", "desk": "table_0"}, ["cup", "desk", "lamp"]

    def ended(position: tuple[float, float, float]) -> Rollout:
        moved = replace(scene, objects={**scene.objects, "glass_0": replace(glass, position=position)})
        with World(moved) as world:
            states = (world.pack(),)
        return cast(Rollout, SimpleNamespace(scene=scene, trajectory=SimpleNamespace(packed_states=states)))

    x, y, z = glass.position
    away = ended((x + 5.0, y, glass.extent_m[2] / 2))
    assert reached([["(not (ontop cup desk))"]], ids, made, away) == ""
    assert reached([["(ontop lamp desk)"], ["(not (ontop cup desk))"]], ids, made, away) == ""
    words = reached([["(ontop cup desk)"], ["(ontop lamp desk)"]], ids, made, away)
    assert words == "(ontop cup desk) holds at the start; lamp is lost"
    assert table.id in reached([["(not (ontop cup desk))"]], ids, made, ended((x, y, z)))


def test_a_picture_that_takes_too_long_is_lost(tmp_path: Path) -> None:
    write_tiny(tmp_path)
    chosen = read_pictures(tmp_path, tmp_path, "tuning", ["tiny_desk"])
    (done,) = measure_pictures(tmp_path / "out", chosen, lambda one: None, limit_s=0.2)
    assert done["refused_kind"] == "time" and {one["lost"] for one in done["things"]} == {
        "the picture is refused: time"
    }


def test_what_is_missing_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_tiny(tmp_path)

    def refusal(*given: str, annotations: Path = tmp_path) -> str:
        asked = ["--pictures", str(tmp_path), "--annotations", str(annotations), "--out", str(tmp_path / "out"), *given]
        assert run(["bench", "photo", *asked]) == 2 and not (tmp_path / "out").exists()
        return capsys.readouterr().err

    assert "no picture 'tiny_dsk'; the nearest are tiny_desk" in refusal("--only", "tiny_dsk")
    assert "none of blank is in the judging half" in refusal("--only", "blank", "--half", "judging")
    assert "is no index of pictures" in refusal(annotations=tmp_path / "nowhere")
    (tmp_path / "tiny_desk_depth.png").unlink()
    assert "lacks tiny_desk_depth.png; fetch them by: python -m benchmarks.pictures.fetch" in refusal()
