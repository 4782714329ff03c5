"""What hangs on a wall is there, fixed, and under its name; what stands before a wall is not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

import llm
from executor.assets.families.generic import GENERIC
from executor.assets.library import LIBRARY
from executor.photo.errors import LostCause
from executor.photo.fitting.hypothesis import PoseHypothesis, hypothesis_of
from executor.photo.fitting.starts import generic_models, stands_on_floor
from executor.photo.geometry.observation import Observation
from executor.photo.inputs.annotations import FLOOR, Detection, is_left_out
from executor.photo.inputs.annotations import WALL as WALL_ITSELF
from executor.photo.inputs.usual import carries, hung_depth_m, is_hollow, usual_height_m, usual_thickness_m
from executor.photo.output import stands_on
from executor.photo.overlaps import resolve_overlaps
from executor.photo.pipeline import PhotoResult
from executor.photo.room.estimate import tops_of
from executor.photo.room.reconstruct import FittedRoom, reconstruct
from executor.photo.scene import scene_of
from executor.photo.yielding import YIELDS, yielding
from oag.model.symbols import Kind
from tests.executor.photo.test_fit import TABLE, seen_from_above

BOX = GENERIC["generic_box"]
WALL = PoseHypothesis(BOX, 3.05, 0.0, 0.0, 0.0, (0.1, 4.0, 2.4))
PANEL = PoseHypothesis(BOX, 2.96, 0.1, 0.0, 1.0, (0.08, 0.36, 0.26))
BOARD = PoseHypothesis(BOX, 2.85, 0.1, 0.0, 0.97, (0.3, 0.6, 0.03))
MUG = PoseHypothesis(BOX, 2.8, 0.1, 0.0, 1.0, (0.08, 0.09, 0.1))


def named(label: str, box: Detection) -> Detection:
    """Return a box under another name, which the library does not have."""
    return replace(box, label=label, category=label.replace(" ", "_"))


def flat(seen: Observation) -> Observation:
    """Return a picture without its depth."""
    return replace(seen, z_m=np.zeros_like(seen.z_m), heading_rad=0.0)


@pytest.fixture(scope="module")
def on_wall() -> FittedRoom:
    """A panel on a wall, under a name that tells nothing."""
    seen, (_, panel) = seen_from_above(WALL, PANEL)
    return reconstruct(seen, [named("gadget", panel)], ())


def test_a_thing_on_a_wall_is_at_its_place_and_size(on_wall: FittedRoom) -> None:
    (thing,) = on_wall.things
    guess = thing.fit.guess
    assert guess.fixed and thing.id == "gadget_0"
    assert (guess.x_m, guess.y_m, guess.bottom_m) == pytest.approx((2.96, 0.1, 1.0), abs=0.03)
    assert guess.size_m == pytest.approx(PANEL.size_m, abs=0.04)
    assert thing.fit.in_box > 0.9
    assert hypothesis_of(guess.to_json()) == guess


def test_it_neither_falls_nor_is_taken_nor_carries_anything(on_wall: FittedRoom) -> None:
    _, made = scene_of(on_wall, "drawn")
    assert made.refused == "" and made.scene is not None
    panel = made.scene.objects["gadget_0"]
    assert panel.kind is Kind.FIXED and made.settled_m["gadget_0"] == 0.0
    assert not [fact for fact in made.scene.facts if "gadget_0" in str(fact)]
    assert "gadget_0 hangs on a wall" in " ".join(made.notes)
    with pytest.raises(llm.QueryError, match="lifts items only"):
        llm.propose("pick up the gadget", made.scene, model=None)


def test_what_stands_on_a_board_before_a_wall_does_not_hang() -> None:
    seen, (_, _, mug) = seen_from_above(WALL, BOARD, MUG)
    (thing,) = reconstruct(seen, [named("gadget", mug)], ()).things
    assert not thing.fit.guess.fixed


@pytest.mark.parametrize(("label", "side_m", "hangs"), [("shoe", 0.25, False), ("television", 0.6, True)])
def test_what_people_take_does_not_hang_where_its_box_is_on_something(label: str, side_m: float, hangs: bool) -> None:
    stairs = PoseHypothesis(BOX, 3.05, 0.0, 0.0, 0.0, (0.6, 2.0, 1.7))
    before = PoseHypothesis(BOX, 2.72, 0.1, 0.0, 0.9, (0.06, side_m, side_m))
    seen, (steps, box) = seen_from_above(stairs, before)
    things = reconstruct(seen, [named("stairs", steps), named(label, box)], ()).things
    assert things[1].fit.guess.fixed is hangs


def test_what_stands_on_the_floor_at_a_wall_does_not_hang() -> None:
    bin_ = replace(PANEL, bottom_m=0.0, size_m=(0.25, 0.36, 0.5), x_m=2.85)
    seen, (_, box) = seen_from_above(WALL, bin_)
    (thing,) = reconstruct(seen, [named("gadget", box)], ()).things
    assert not thing.fit.guess.fixed


@pytest.mark.parametrize("label", ["picture", "wall clock"])
def test_without_depth_a_name_tells_what_hangs_and_the_back_of_furniture_how_far_off(label: str) -> None:
    seen, (table, box) = seen_from_above(TABLE, replace(PANEL, bottom_m=0.75))
    things = reconstruct(flat(seen), [table, named(label, box)], ()).things
    assert things[1].fit.guess.fixed and things[1].fit.in_box > 0.8
    assert things[1].fit.guess.x_m == pytest.approx(2.8, abs=0.3)


@pytest.mark.parametrize(("bottom_m", "hangs"), [(1.1, True), (0.1, False)])
def test_without_depth_what_ends_beyond_all_furniture_hangs_whatever_it_is_called(bottom_m: float, hangs: bool) -> None:
    beside = replace(PANEL, y_m=-1.1, bottom_m=bottom_m)
    seen, (table, box) = seen_from_above(TABLE, beside)
    things = reconstruct(flat(seen), [table, named("gadget", box)], ()).things
    assert things[1].fit.guess.fixed is hangs


def test_a_picture_that_stands_on_a_table_does_not_hang() -> None:
    standing = PoseHypothesis(BOX, 2.2, 0.1, 0.3, 0.7, (0.05, 0.2, 0.15))
    seen, (table, box) = seen_from_above(TABLE, standing)
    for view in (seen, flat(seen)):
        things = reconstruct(view, [table, named("picture", box)], ()).things
        assert not things[1].fit.guess.fixed
        assert things[1].fit.guess.bottom_m == pytest.approx(0.7, abs=0.1)


def test_a_rug_is_of_the_floor_and_a_picture_is_a_thing() -> None:
    assert is_left_out("rug") and is_left_out("wall")
    assert not is_left_out("picture") and not is_left_out("window")


def test_names_tell_what_usually_hangs_carries_and_is_hollow() -> None:
    assert hung_depth_m("fire extinguisher") == hung_depth_m("extinguishers") and hung_depth_m("alarm") is None
    assert hung_depth_m("wall lamp") is not None and hung_depth_m("lamp") is None
    assert hung_depth_m("wall") is None and hung_depth_m("42") is None
    assert carries("tea tray") and not carries("keyboard")
    assert is_hollow("trash can") and not is_hollow("soup can")


@pytest.mark.parametrize(("label", "shapes"), [("trash can", 2), ("sink", 2), ("gadget", 5)])
def test_what_is_hollow_by_its_name_is_an_open_box_or_cylinder(label: str, shapes: int) -> None:
    entries = generic_models(Detection(label, None, (0.0, 0.0, 9.0, 9.0), 1.0, "me"))
    assert len(entries) == shapes and "generic_open_box" in {entry.model for entry in entries}


def test_a_sink_is_in_a_top_and_not_on_the_floor() -> None:
    assert not stands_on_floor(Detection("sink", "sink", (0.0, 0.0, 9.0, 9.0), 1.0, "me"))
    assert stands_on_floor(Detection("desk", "desk", (0.0, 0.0, 9.0, 9.0), 1.0, "me"))


def test_what_is_over_a_board_is_on_it_and_what_is_wider_is_on_the_table() -> None:
    board = PoseHypothesis(replace(BOX, category="board"), 2.0, 0.0, 0.0, 0.7, (0.4, 0.4, 0.012))
    can = PoseHypothesis(LIBRARY["can"], 2.05, 0.05, 0.0, 0.7, (0.07, 0.07, 0.1))
    found, _ = resolve_overlaps({"table": TABLE, "board": board, "can": can}, ())
    assert found["can"].bottom_m == pytest.approx(0.712) and found["can"].x_m == pytest.approx(2.05)
    beside, _ = resolve_overlaps({"table": TABLE, "board": board, "can": replace(can, y_m=0.3)}, ())
    assert beside["can"].bottom_m == pytest.approx(0.7)
    wide = PoseHypothesis(BOX, 2.0, 0.0, 0.0, 0.7, (0.1, 0.6, 0.2))
    kept, _ = resolve_overlaps({"table": TABLE, "board": replace(board, size_m=(0.2, 0.2, 0.012)), "wide": wide}, ())
    assert kept["wide"].bottom_m == pytest.approx(0.7)


def test_a_thing_between_boards_is_on_one_of_them_and_not_on_the_next_shelfs() -> None:
    shelf = PoseHypothesis(LIBRARY["shelf_open"], 2.0, 0.0, 0.0, 0.0, (0.3, 0.8, 1.5), (("boards", 1),))
    other = replace(shelf, y_m=0.85, parameters=(("boards", 3),))
    levels = [
        sorted({round(top.height_m, 3) for top in tops_of([one]) if top.height_m < 1.4}) for one in (shelf, other)
    ]
    between = next(level for level in levels[1] if min(abs(level - own) for own in levels[0]) > 0.13)
    can = PoseHypothesis(LIBRARY["can"], 2.0, 0.3, 0.0, between, (0.07, 0.07, 0.1))
    found, _ = resolve_overlaps({"shelf": shelf, "other": other, "can": can}, ())
    assert abs(found["can"].y_m) < 0.4 and found["can"].bottom_m == pytest.approx(
        min(levels[0], key=lambda level: abs(level - between)), abs=0.002
    )
    # What is before a shelf is on no board.
    before, _ = resolve_overlaps({"shelf": shelf, "can": replace(can, x_m=1.2, bottom_m=0.0)}, ())
    assert before["can"].bottom_m == 0.0 and before["can"].x_m == pytest.approx(1.2)


def test_a_person_may_say_that_something_hangs_or_that_it_does_not() -> None:
    seen, (_, _, mug) = seen_from_above(WALL, BOARD, MUG)
    (thing,) = reconstruct(seen, [replace(named("gadget", mug), on=WALL_ITSELF)], ()).things
    assert thing.fit.guess.fixed
    seen, (_, panel) = seen_from_above(WALL, PANEL)
    (thing,) = reconstruct(seen, [replace(named("picture", panel), on=FLOOR)], ()).things
    assert not thing.fit.guess.fixed and thing.fit.guess.bottom_m == 0.0


def test_furniture_on_a_wall_is_furniture_and_hangs_where_a_person_says_so() -> None:
    assert hung_depth_m("wall cabinet") is hung_depth_m("wall shelf") is hung_depth_m("wall oven") is None
    assert hung_depth_m("wall outlet") is not None
    cabinet = replace(PANEL, x_m=2.82, bottom_m=1.0, size_m=(0.35, 0.6, 0.5))
    seen, (_, box) = seen_from_above(WALL, cabinet)
    detection = replace(named("wall cabinet", box), category="cabinet")
    for view in (seen, flat(seen)):
        found = reconstruct(view, [replace(detection, on=WALL_ITSELF)], ())
        guess = found.things[0].fit.guess
        assert not guess.fixed and guess.bottom_m > 0.4
        assert found.things[0].fit.in_box > 0.5
    found, made = scene_of(reconstruct(seen, [replace(detection, on=WALL_ITSELF)], ()), "drawn")
    assert made.refused == "" and made.scene is not None
    result = cast(PhotoResult, SimpleNamespace(found=found, made=made))
    assert list(stands_on(result).values()) == ["wall"]
    (hung,) = (one for one in made.scene.objects.values() if one.category != "wall")
    assert hung.kind is Kind.ARTICULATED and hung.position[2] == pytest.approx(1.25, abs=0.1)


@pytest.mark.parametrize("label", ["alarm clock", "calendar", "soap dispenser"])
def test_what_stands_on_a_board_without_a_box_does_not_hang_by_its_name(label: str) -> None:
    seen, (_, _, mug) = seen_from_above(WALL, BOARD, MUG)
    (thing,) = reconstruct(seen, [named(label, mug)], ()).things
    assert not thing.fit.guess.fixed
    seen, (_, panel) = seen_from_above(WALL, PANEL)
    (thing,) = reconstruct(seen, [named(label, panel)], ()).things
    assert thing.fit.guess.fixed


@pytest.mark.parametrize(("label", "bottom_m", "high_m"), [("grandfather clock", 0.0, 1.7), ("floor mirror", 0.0, 1.4)])
def test_without_depth_what_ends_on_the_floor_does_not_hang_by_its_name(
    label: str, bottom_m: float, high_m: float
) -> None:
    tall = PoseHypothesis(BOX, 2.6, -1.1, 0.0, bottom_m, (0.2, 0.4, high_m))
    seen, (table, box) = seen_from_above(TABLE, tall)
    things = reconstruct(flat(seen), [table, named(label, box)], ()).things
    assert not things[1].fit.guess.fixed


@pytest.mark.parametrize(("label", "hangs"), [("picture", True), ("gadget", True), ("table", False)])
def test_what_the_sensor_does_not_see_hangs_where_nothing_is_below_it(label: str, hangs: bool) -> None:
    seen, (_, box) = seen_from_above(WALL, replace(PANEL, bottom_m=1.3))
    holes = replace(seen, z_m=np.where(box.pixels(seen.size_px), 0.0, seen.z_m))
    room = reconstruct(holes, [named(label, box)], ())
    assert [thing.fit.hangs for thing in room.things] == [True] * hangs
    assert [one.cause for one in room.unfitted] == [LostCause.STANDS] * (not hangs)


def test_without_depth_a_socket_near_the_floor_hangs() -> None:
    socket = PoseHypothesis(BOX, 2.9, -1.1, 0.0, 0.3, (0.03, 0.1, 0.1))
    seen, (table, box) = seen_from_above(TABLE, socket)
    assert reconstruct(flat(seen), [table, named("socket", box)], ()).things[1].fit.guess.fixed


def test_what_is_fixed_stays_in_the_plane_of_its_wall() -> None:
    clock, picture = (replace(PANEL, y_m=y, fixed=True) for y in (0.1, 0.3))
    room, _ = resolve_overlaps({"clock": clock, "picture": picture}, ())
    assert {one.x_m for one in room.values()} == {PANEL.x_m}
    assert abs(room["clock"].y_m - room["picture"].y_m) >= 0.36
    item = replace(picture, fixed=False)
    room, _ = resolve_overlaps({"clock": clock, "thing": item}, ())
    assert room["clock"] == clock


@pytest.mark.parametrize("number", range(len(YIELDS)))
def test_what_physics_refuses_on_a_wall_keeps_its_back_there(on_wall: FittedRoom, number: int) -> None:
    _, made = scene_of(on_wall, "drawn")
    (thing,) = on_wall.things
    assert made.scene is not None
    other = replace(made.scene.objects["gadget_0"], id="other_0")
    crowded = replace(made.scene, objects={**made.scene.objects, "other_0": other})
    before = thing.fit.guess
    guess = yielding(thing, crowded, crowded, number)
    assert guess.fixed and guess.x_m + guess.size_m[0] / 2 == pytest.approx(before.x_m + before.size_m[0] / 2, abs=2e-3)


def test_names_of_two_words_are_not_what_their_last_word_is_alone() -> None:
    assert usual_height_m("desk phone") is None and usual_height_m("mobile phone") is not None
    assert usual_height_m("toilet paper") is None and usual_height_m("paper") is not None
    assert usual_thickness_m("bed frame") is None and usual_thickness_m("picture frames") is not None
    assert not is_hollow("coffee pot") and not is_hollow("tea pots") and is_hollow("flower pots")
    assert None not in {hung_depth_m(f"{one} board") for one in ("white", "bulletin", "notice", "dart")}
    assert hung_depth_m("cutting board") is None
    assert carries("boxes") and hung_depth_m("light switches") == hung_depth_m("switch")


@pytest.mark.parametrize("above_m", [0.1, 0.3])
def test_a_picture_above_a_sideboard_without_a_box_hangs(above_m: float) -> None:
    sideboard = PoseHypothesis(BOX, 2.78, 0.1, 0.0, 0.0, (0.4, 1.2, 1.0 - above_m))
    seen, (_, _, panel) = seen_from_above(WALL, sideboard, PANEL)
    (thing,) = reconstruct(seen, [named("picture", panel)], ()).things
    assert thing.fit.guess.fixed and thing.fit.guess.bottom_m == pytest.approx(1.0, abs=0.05)
