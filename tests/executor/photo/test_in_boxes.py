"""What is put right without depth keeps its outline in its box, and its support: sinks, shelves, stacks and plates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from executor.assets.families.generic import BOARDS, GENERIC, SHELF
from executor.assets.library import LIBRARY
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.inputs.annotations import FLOOR, WALL, Detection
from executor.photo.overlaps import resolve_overlaps
from executor.photo.room.beneath import supports_of
from executor.photo.room.jointly import Jointly
from executor.photo.room.reconstruct import FittedRoom, Listener, reconstruct
from executor.photo.separation import separated
from executor.scenes.support_relations import derive_support_relations, upright_solids
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
    kept = separated(first, second, (stays, lambda of: 1.0 - 10.0 * abs(of.x_m - 0.17)))[1]
    assert kept.x_m == pytest.approx(0.17) and kept.y_m > 0.19
    # Where neither way is in its box, the one that is in the other on one side becomes shorter there.
    corner = replace(second, x_m=0.18, y_m=0.0)
    boxed = (stays, lambda of: 1.0 - 20.0 * abs(of.x_m + of.size_m[0] / 2 - 0.23))
    _, cut = separated(first, corner, boxed)
    assert cut.size_m[0] < 0.09 and cut.x_m + cut.size_m[0] / 2 == pytest.approx(0.23)
    assert separated(first, replace(second, x_m=0.4)) == (first, replace(second, x_m=0.4))


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
