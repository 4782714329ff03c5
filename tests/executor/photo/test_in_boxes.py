"""What is put right without depth keeps its outline in its box, and its support: sinks, shelves, stacks and plates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from executor.assets.families.generic import BOARDS, GENERIC, SHELF
from executor.assets.footprint import Footprint, overlap_depth_m
from executor.assets.library import LIBRARY
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.inputs.annotations import FLOOR, WALL, Detection
from executor.photo.overlaps import resolve_overlaps
from executor.photo.room.beneath import supports_of
from executor.photo.room.jointly import Jointly
from executor.photo.room.pieces import Piece, on_boards
from executor.photo.room.reconstruct import FittedRoom, Listener, reconstruct
from executor.photo.separation import Boxed, separated
from executor.scenes.support_relations import derive_support_relations, upright_solids
from oag import SceneObject
from tests.executor.photo.test_fit import BOWL, TABLE, seen_from_above
from tests.executor.photo.test_hanging import flat, named

BOX = GENERIC["generic_box"]
CUP = PoseHypothesis(LIBRARY["cup"], 2.05, 0.1, 0.0, 0.7, (0.07, 0.07, 0.09))


def on_of(things: Sequence[PoseHypothesis], labels: Sequence[str]) -> list[int]:
    """Return what carries each of some things under other names, seen without depth."""
    seen, boxes = seen_from_above(*things)
    return supports_of(flat(seen), [named(label, box) for label, box in zip(labels, boxes, strict=True)])


@pytest.mark.parametrize(
    ("below", "above", "x_m", "bottom_m", "on"),
    [
        ("roll of tape", "cup", 2.05, 0.74, 1),
        ("roll of tape", "cup", 2.30, 0.70, 0),
        ("roll of tape", "cup", 1.95, 0.70, 0),
        ("wooden block", "cup", 2.05, 0.74, 1),
        ("cup noodles", "cup noodles", 2.05, 0.74, 1),
    ],
)
def test_what_ends_amid_an_item_and_stands_out_above_it_is_on_it(
    below: str, above: str, x_m: float, bottom_m: float, on: int
) -> None:
    block = PoseHypothesis(BOX, 2.05, 0.1, 0.0, 0.7, (0.08, 0.08, 0.04))
    cup = replace(CUP, x_m=x_m, bottom_m=bottom_m)
    assert on_of([TABLE, block, cup], ["table", below, above])[2] == on


def test_what_is_in_a_sink_is_in_it_and_not_on_the_counter() -> None:
    counter = PoseHypothesis(LIBRARY["counter_plain"], 2.0, 0.0, 0.0, 0.0, (0.65, 1.4, 0.8))
    sink = PoseHypothesis(GENERIC["generic_open_box"], 1.95, 0.0, 0.0, 0.8, (0.45, 0.7, 0.1))
    plate = PoseHypothesis(LIBRARY["plate"], 1.95, 0.1, 0.0, 0.81, (0.2, 0.2, 0.02))
    things, labels = [counter, sink, plate], ["counter", "sink", "plate"]
    assert on_of(things, labels) == [FLOOR, 0, 1]
    called = {
        label: replace(thing, entry=replace(thing.entry, category=label))
        for label, thing in zip(labels, things, strict=True)
    }
    found, _ = resolve_overlaps(called, (), on={"sink": "counter", "plate": "sink"})
    made = {key: guess.as_object(key) for key, guess in found.items()}
    facts = {str(fact) for fact in derive_support_relations(upright_solids(made))}
    assert facts == {"(ontop sink counter)", "(inside plate sink)"}
    on_counter = replace(called["plate"], y_m=0.5, bottom_m=0.8).as_object("plate")
    facts = {str(fact) for fact in derive_support_relations(upright_solids({**made, "plate": on_counter}))}
    assert facts == {"(ontop sink counter)", "(ontop plate counter)"}


def test_an_outlet_hangs() -> None:
    outlet = PoseHypothesis(BOX, 3.0, 0.9, 0.0, 0.3, (0.03, 0.08, 0.12))
    assert on_of([TABLE, outlet], ["table", "outlet"])[1] == WALL
    assert on_of([TABLE, outlet], ["table", "box"])[1] == FLOOR


SHELF_AT = PoseHypothesis(GENERIC[SHELF], 2.2, 0.0, 0.0, 0.0, (0.3, 0.8, 1.2)).with_parameters(
    board_0_share=0.25, board_1_share=0.7
)


def test_the_boards_of_a_shelf_are_where_what_is_on_them_ends() -> None:
    levels_m = {"low": 0.25 * 1.2, "high": 0.7 * 1.2}
    cans = [
        PoseHypothesis(LIBRARY["can"], 2.12, y_m, 0.0, levels_m[level], (0.066, 0.066, 0.12))
        for level, y_m in (("low", -0.2), ("low", 0.2), ("high", 0.05))
    ]
    seen, (shelf, *boxes) = seen_from_above(SHELF_AT, *cans)
    room = reconstruct(flat(seen), [named("shelf", shelf), *(named("can", box) for box in boxes)], ())
    fit, *others = (thing.fit for thing in room.things)
    assert fit.guess.entry.model == SHELF
    assert min(one.in_box for one in (fit, *others)) > 0.6
    shares = dict(fit.guess.parameters)
    found_m = sorted(float(str(shares[board.name])) * fit.guess.size_m[2] for board in BOARDS if board.name in shares)
    assert found_m == pytest.approx([levels_m["low"], levels_m["high"]], abs=0.12)
    bottoms_m = [one.guess.bottom_m for one in others]
    assert bottoms_m[0] == bottoms_m[1] < bottoms_m[2] - 0.3
    kept, _ = resolve_overlaps(room.guesses, (), on=room.on, fills=room.fills)
    assert all(abs(kept[key].bottom_m - guess.bottom_m) < 0.03 for key, guess in room.guesses.items())


def test_what_is_separated_goes_where_its_outline_stays_in_its_box() -> None:
    first = PoseHypothesis(BOX, 0.0, 0.0, 0.0, 0.0, (0.3, 0.3, 0.1))
    second = replace(first, x_m=0.17, y_m=0.12, size_m=(0.1, 0.1, 0.1))
    near = separated(first, second)[1]
    assert near.x_m > 0.19 and near.y_m == pytest.approx(0.12)
    stays = lambda of: 1.0 - 10.0 * (abs(of.x_m) + abs(of.y_m))  # noqa: E731
    moves = lambda of: 1.0 - 10.0 * abs(of.x_m - 0.17)  # noqa: E731
    kept = separated(first, second, (Boxed.of(stays, first), Boxed.of(moves, second)))[1]
    assert kept.x_m == pytest.approx(0.17) and kept.y_m > 0.19
    # Where neither way is in its box, the one that is in the other on one side becomes shorter there.
    corner = replace(second, x_m=0.18, y_m=0.0)
    ends = lambda of: 1.0 - 20.0 * abs(of.x_m + of.size_m[0] / 2 - 0.23)  # noqa: E731
    _, cut = separated(first, corner, (Boxed.of(stays, first), Boxed.of(ends, corner)))
    assert cut.size_m[0] < 0.09 and cut.x_m + cut.size_m[0] / 2 == pytest.approx(0.23)
    sized = Boxed.of(stays, first, is_sized=True), Boxed.of(ends, corner, is_sized=True)
    given = separated(first, corner, sized)
    assert [one.size_m for one in given] == [first.size_m, corner.size_m] and given != (first, corner)
    assert separated(first, replace(second, x_m=0.4)) == (first, replace(second, x_m=0.4))


def test_cuts_are_bounded_together_and_a_size_that_a_person_gave_is_not_cut() -> None:
    middle = PoseHypothesis(BOX, 0.0, 0.0, 0.0, 0.0, (0.1, 0.1, 0.1))
    sides = {name: replace(middle, x_m=x_m, size_m=(0.15, 0.15, 0.1)) for name, x_m in (("a", 0.1), ("b", -0.1))}
    stays = {name: (lambda of, at=at: 1.0 - 99.0 * (of != at)) for name, at in sides.items()}
    reaches = lambda of: 1.0 - 20.0 * (abs(of.y_m) + max(0.0, abs(of.x_m) + of.size_m[0] / 2 - 0.05))  # noqa: E731
    fills = {**stays, "middle": reaches}
    room = {"middle": middle, **sides}
    cut, _ = resolve_overlaps(room, (), fills=fills)
    assert 0.06 - 1e-9 <= cut["middle"].size_m[0] < 0.09 and cut["middle"].size_m[1:] == (0.1, 0.1)
    given, _ = resolve_overlaps(room, (), fills=fills, sized=("middle",))
    assert given["middle"].size_m == middle.size_m and given != room


def test_furniture_of_a_given_size_is_moved_out_of_a_row_and_does_not_grow() -> None:
    cabinet = PoseHypothesis(LIBRARY["cabinet_two_doors"], 2.0, 0.0, 0.0, 0.0, (0.6, 0.9, 0.8))
    row = {"a": cabinet, "b": replace(cabinet, y_m=0.86)}
    assert resolve_overlaps(row, ())[0]["a"].size_m[1] < 0.89
    found, _ = resolve_overlaps(row, (), sized=("a", "b"))
    assert found["a"].size_m == found["b"].size_m == cabinet.size_m
    assert found["b"].y_m - found["a"].y_m > 0.9
    beyond = replace(CUP, x_m=TABLE.x_m, y_m=TABLE.y_m + TABLE.size_m[1] / 2 + 0.2, bottom_m=TABLE.size_m[2])
    grown, _ = resolve_overlaps({"table": TABLE, "cup": beyond}, ())
    kept, _ = resolve_overlaps({"table": TABLE, "cup": beyond}, (), sized=("table",))
    assert grown["table"].size_m != TABLE.size_m == kept["table"].size_m


def test_a_way_out_of_many_parts_is_all_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    block = PoseHypothesis(BOX, 0.2, 0.0, 0.0, 0.0, (0.1, 0.1, 0.2))
    frame = PoseHypothesis(BOX, 0.0, 0.0, 0.0, 0.0, (2.0, 2.0, 0.2))
    slats = [replace(frame, x_m=-0.975 + 0.075 * number, size_m=(0.01, 2.0, 0.2)) for number in range(27)]

    def parts_of(obj: SceneObject) -> list[Footprint]:
        return [Footprint.of(one.as_object()) for one in (slats if obj.bbox_extent[0] > 1.0 else [block_at(obj)])]

    def block_at(obj: SceneObject) -> PoseHypothesis:
        return replace(block, x_m=obj.position[0], y_m=obj.position[1])

    monkeypatch.setattr("executor.photo.separation.solid_parts", parts_of)
    _, out = separated(frame, block)
    assert overlap_depth_m(parts_of(frame.as_object()), parts_of(out.as_object())) == 0.0
    assert out.x_m > 1.0 and out.y_m == 0.0, "the nearest side"


@pytest.mark.parametrize(("bottom_m", "height_m", "can_m"), [(0.8, 1.2, 1.10), (0.72, 0.6, 0.73)])
def test_a_thing_on_a_raised_shelf_is_on_the_nearest_board(bottom_m: float, height_m: float, can_m: float) -> None:
    shelf = PoseHypothesis(GENERIC[SHELF], 2.2, 0.0, 0.0, bottom_m, (0.3, 0.8, height_m)).with_parameters(
        board_0_share=0.25 if bottom_m == 0.8 else 0.5, board_1_share=0.5
    )
    shelf = replace(shelf, entry=replace(shelf.entry, category="shelf"))
    can = PoseHypothesis(LIBRARY["can"], 2.15, 0.0, 0.0, can_m, (0.066, 0.066, 0.12))
    found, _ = resolve_overlaps({"shelf": shelf, "can": can}, (), on={"can": "shelf"})
    assert found["can"].bottom_m == pytest.approx(can_m, abs=0.02)


def test_flat_things_on_one_board_are_on_one_and_more_boards_than_a_shelf_has_are_none() -> None:
    seen, (shelf,) = seen_from_above(SHELF_AT)
    left, top, _, bottom = shelf.box_px
    things = [named("shelf", shelf)]
    entry = replace(GENERIC[SHELF], category="shelf")
    lower = top + 0.2 * (bottom - top)

    def boards_of(ends: Sequence[float], high: float) -> list[int | None]:
        boxes = [replace(shelf, box_px=(left + 4.0, lower + end - high, left + 9.0, lower + end)) for end in ends]
        pieces = [Piece(things[0], entry, FLOOR), *(Piece(named("book", box), BOX, 0) for box in boxes)]
        return [one.board for one in on_boards(flat(seen), pieces)[1:]]

    step = (bottom - top) / 10.0
    assert boards_of([0.0, 0.2 * step, 4 * step], 0.1 * step) == [0, 0, 1]
    assert boards_of([number * step for number in range(6)], 0.8 * step) == [0, 1, 2, 3, 4, 5]
    assert boards_of([number * step for number in range(8)], 0.8 * step) == [None] * 8


def test_what_reaches_over_the_rim_of_its_plate_stays_on_it() -> None:
    plate = PoseHypothesis(LIBRARY["plate"], 2.05, 0.0, 0.0, 0.7, (0.25, 0.25, 0.02))
    cup = replace(CUP, y_m=0.07, bottom_m=0.705)
    room = {"table": TABLE, "plate": plate, "cup": cup}
    found, _ = resolve_overlaps(room, (), on={"plate": "table", "cup": "plate"})
    assert found["plate"].entry.model == "generic_cylinder" and found["plate"].entry.category == "plate"
    assert found["cup"].bottom_m == pytest.approx(found["plate"].bottom_m + 0.02)
    assert (found["cup"].x_m, found["cup"].y_m) == pytest.approx((2.05, 0.07), abs=0.01)
    amid, _ = resolve_overlaps({**room, "cup": replace(cup, y_m=0.0)}, (), on={"plate": "table", "cup": "plate"})
    assert amid["plate"].entry.model == "plate"


def test_nothing_is_started_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, boxes = seen_from_above(TABLE, BOWL)
    counts: list[int] = []
    start = Jointly._starts

    def counted(problem: Jointly, index: int) -> object:
        counts.append(index)
        return start(problem, index)

    monkeypatch.setattr(Jointly, "_starts", counted)

    def fitted(listener: Listener) -> FittedRoom:
        counts.clear()
        return reconstruct(flat(seen), boxes, (), listener)

    alone, number = fitted(Listener()), len(counts)
    first: list[FittedRoom] = []
    again = fitted(Listener(on_first=first.append))
    assert len(counts) == number and len(first) == 1
    assert again.guesses == alone.guesses


def test_a_thing_of_another_name_is_no_shelf() -> None:
    seen, (box,) = seen_from_above(SHELF_AT)
    (thing,) = reconstruct(flat(seen), [Detection("crate", "crate", box.box_px, 1.0, "drawn")], ()).things
    assert thing.fit.guess.entry.model != SHELF
