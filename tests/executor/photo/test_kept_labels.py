"""A person's label is kept or its thing dropped, what is no success is dropped with its reason, and is never sure."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from executor.assets.library import LIBRARY
from executor.cli.app import run
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.fitting.likelihood import Fit
from executor.photo.geometry.observation import Observation
from executor.photo.inputs.annotations import Detection, Provenance, read_boxes
from executor.photo.perception import FoundBox, to_detections
from executor.photo.room.estimate import RoomEstimate
from executor.photo.room.fitter import STOOD_OUT, RoomFitter
from executor.photo.room.reconstruct import FittedRoom, FittedThing, reconstruct
from executor.photo.scene import scene_of
from tests.executor.photo.test_by_sight import lit, monocular
from tests.executor.photo.test_fit import BOWL, TABLE, seen_from_above

MICROWAVE = PoseHypothesis(LIBRARY["microwave_side_hinge"], 2.2, 0.0, 0.1, 0.7, (0.4, 0.48, 0.3))
CHAIR = PoseHypothesis(LIBRARY["chair_wooden"], 1.9, 0.0, 0.3, 0.0, (0.42, 0.41, 0.88))


def called(box: Detection, label: str, provenance: Provenance = "person") -> Detection:
    """Return a box with another label."""
    return replace(box, label=label, category=label, provenance=provenance)


def known(seen: Observation, *things: tuple[Detection, PoseHypothesis]) -> RoomEstimate:
    """Return a room in which some boxes have been fitted."""
    room = RoomEstimate(seen, (), [box for box, _ in things], 0.0)
    for index, (_, guess) in enumerate(things):
        room.add_fit(index, Fit(guess, 0.0, (), 1.0, 0.005, 100, None))
    return room


def written(folder: Path, seen: Observation, things: list[dict[str, object]]) -> list[str]:
    """Write an observation as files, and return the command that makes a scene of it."""
    Image.fromarray(seen.rgb).save(folder / "room.png")
    np.save(folder / "depth.npy", seen.z_m)
    K = [[seen.K.fx, 0.0, seen.K.cx], [0.0, seen.K.fy, seen.K.cy], [0.0, 0.0, 1.0]]
    (folder / "camera.json").write_text(json.dumps({"K": K}))
    (folder / "boxes.json").write_text(json.dumps({"things": things}))
    beside = ("depth.npy", "camera.json", "boxes.json")
    depth, camera, boxes = (str(folder / name) for name in beside)
    return ["photo", str(folder / "room.png"), "--depth", depth, "--camera", camera, "--boxes", boxes]


@pytest.mark.slow
@pytest.mark.parametrize("label", ["cup", "chair"])
def test_a_persons_label_is_kept_or_its_thing_dropped(label: str) -> None:
    seen, (table, bowl) = seen_from_above(TABLE, BOWL)
    room = reconstruct(seen, [table, called(bowl, label)], ())
    made = {thing.detection.label: thing.fit.guess.entry.category for thing in room.things}
    left = {one.detection.label: one.reason for one in room.unfitted}
    assert made["table"] == "table" and set(made) | set(left) == {"table", label}
    assert made.get(label, label) == label and all(left.values())


@pytest.mark.parametrize(
    ("provenance", "taken_for"), [pytest.param("detector", "chair_wooden", marks=pytest.mark.slow), ("person", "")]
)
def test_by_sight_only_a_detectors_label_gives_way(provenance: Provenance, taken_for: str) -> None:
    seen, (box,) = monocular(CHAIR)
    room = RoomEstimate(seen, (), [called(box, "can", provenance)], 0.0)
    fitter = RoomFitter(room)
    fitter.fit(0, None, ())
    fitter.fit_anything(0)
    assert (room.fits[0].guess.entry.model if 0 in room.fits else "") == taken_for


@pytest.mark.slow
def test_what_costs_less_by_another_name_is_no_other_thing_where_a_person_has_named_it() -> None:
    bare = PoseHypothesis(LIBRARY["cabinet_drawers"], 3.6, -0.6, 0.35, 0.0, (0.6, 0.583, 0.736))
    dresser = bare.with_parameters(drawers=2, handle_length_m=0.3)
    seen, (box,) = seen_from_above(dresser)
    room = RoomEstimate(lit(seen, dresser), (), [called(box, "countertop")], 0.0)
    fitter = RoomFitter(room)
    fitter.fit(0, [0.0], ())
    assert fitter.rename(0) == "countertop: counter_plain"
    assert all(one.guess.entry.category == "countertop" for one in room.fits[0].alternatives)


@pytest.mark.parametrize(("label", "adopted"), [("table", True), ("wardrobe", False)])
def test_a_box_of_another_name_does_not_adopt_what_was_found_alone(label: str, *, adopted: bool) -> None:
    seen, (box,) = seen_from_above(TABLE)
    room = RoomEstimate(seen, (), [called(box, label)], 0.0)
    room.detections.append(replace(box, label="", category=None, source=STOOD_OUT, provenance="search"))
    room.add_fit(1, Fit(TABLE, 0.0, (), 1.0, 0.005, 100, None))
    assert RoomFitter(room).adopt(0) is adopted
    assert list(room.fits) == ([0] if adopted else [1]) and room.fits.popitem()[1].guess.entry is TABLE.entry


def test_boxes_of_files_are_a_persons_and_those_of_networks_a_detectors(tmp_path: Path) -> None:
    (tmp_path / "boxes.json").write_text(json.dumps({"things": [{"label": "mug", "box": [10, 10, 60, 60]}]}))
    (by_file,) = read_boxes(tmp_path / "boxes.json", (160, 120))
    (by_network,) = to_detections([FoundBox("mug", (10, 10, 60, 60), 0.9)], (160, 120), "SSD").things
    assert (by_file.provenance, by_network.provenance) == ("person", "detector")
    assert by_file.to_json()["provenance"] == "person" and Detection("", None, (0, 0, 9, 9), 1.0, "me").may_be(
        CHAIR.entry
    )


@pytest.mark.slow
@pytest.mark.parametrize("find_more", [False, True])
def test_what_has_no_box_is_searched_for_only_when_asked(*, find_more: bool) -> None:
    seen, (table, _) = seen_from_above(TABLE, BOWL)
    room = reconstruct(seen, [table], (), find_more=find_more)
    assert [thing.fit.guess.entry.category for thing in room.things] == ["table", *["bowl"] * find_more]


def test_a_fit_outside_its_box_is_left_out_and_one_that_is_half_hidden_or_cut_is_not() -> None:
    seen, (table, bowl) = seen_from_above(TABLE, BOWL)
    x0, y0, x1, y1 = table.box_px
    beside = replace(table, box_px=(0.0, y0, x0 + 0.2 * (x1 - x0), y1))
    room = known(seen, (beside, TABLE), (bowl, BOWL))
    room.drop_fits_outside_their_box()
    assert list(room.fits) == [1] and "IoU of 0." in room.reasons[0] and "table_four_legs" in room.reasons[0]
    # A chair before it hides its middle and its lower half; boxes are around what is visible.
    before = replace(CHAIR, x_m=1.2, y_m=0.1)
    for depths in (seen_from_above, monocular):
        seen, boxes = depths(TABLE, before)
        room = known(seen, (boxes[0], TABLE), (boxes[1], before))
        assert min(room.in_boxes().values()) > 0.95
    # What nobody has boxed hides as much of it, where depths show it.
    seen, boxes = seen_from_above(replace(TABLE, x_m=2.6), replace(CHAIR, x_m=1.1, y_m=-0.2))
    room = known(seen, (boxes[0], replace(TABLE, x_m=2.6)))
    assert room.in_boxes()[0] > 0.9
    # Most of it is beyond the picture's lower border.
    near = replace(TABLE, x_m=0.5)
    seen, (cut, *_) = seen_from_above(near)
    assert cut.box_px[3] == seen.size_px[1] and known(seen, (cut, near)).in_boxes()[0] > 0.95


def test_nothing_is_sure_that_explains_nothing_or_is_somewhere() -> None:
    sure = Fit(TABLE, 0.0, (), 1.0, 0.005, 100, None)
    assert sure.confidence > 0.99
    assert replace(sure, explained=0.0).confidence == 0.0 and replace(sure, in_box=0.4).confidence < 0.41
    vague = replace(sure, spread_m=0.4)
    assert vague.confidence < 0.05 < 0.5 < replace(sure, spread_m=0.06).confidence
    assert replace(sure, residual_m=float("inf")).confidence == 0.0


def test_a_thing_that_stands_on_nothing_is_left_out_with_its_reason() -> None:
    _, boxes = seen_from_above(TABLE, MICROWAVE)
    things = [
        FittedThing("table_0", boxes[0], Fit(replace(TABLE, x_m=3.5, y_m=1.0), 0.0, (), 1.0, 0.0, 100, None)),
        FittedThing("microwave_0", boxes[1], Fit(MICROWAVE, 0.0, (), 1.0, 0.0, 100, None)),
    ]
    rest, made = scene_of(FittedRoom(tuple(things), (), ()), "drawn", 0.0)
    assert made.refused == "" and [thing.id for thing in rest.things] == ["table_0"]
    assert rest.unfitted[0].reason == "nothing was found that it stands on, 70 cm above the floor"
    alone, nothing = scene_of(FittedRoom((things[1],), (), ()), "drawn", 0.0)
    assert not alone.things and nothing.scene is None


@pytest.mark.slow
@pytest.mark.physics
def test_the_command_keeps_labels_and_says_what_it_has_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seen, (table, bowl) = seen_from_above(TABLE, BOWL)
    things = [{"label": "table", "box": table.box_px}, {"label": "wardrobe", "box": bowl.box_px}]
    command = written(tmp_path, seen, things)
    assert run([*command, "--out", str(tmp_path / "out")]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "wardrobe: left out" in told and "--find-more" in told
    made = json.loads((tmp_path / "out" / "photo.json").read_text())
    assert {one["model"] for one in made["things"].values()} == {"table_four_legs"}
    assert made["things"]["table_0"]["label_provenance"] == "person"
    assert [one["label"] for one in made["left_out"]] == ["wardrobe"]
    assert run([*command[:-2], "--out", str(tmp_path / "none")]) == 2
    assert "--find-more" in capsys.readouterr().err and not (tmp_path / "none").exists()
