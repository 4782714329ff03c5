"""Drawn rooms are those of a seed; what is measured of them is kept."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks.drawn_rooms.rooms import DrawnRoom, drawn
from executor.bench.photo.pictures import each_once


def test_rooms_are_of_households_and_of_kitchens_by_turns_and_of_other_seeds_beyond_the_first() -> None:
    rooms = drawn(62000, 5, 4)
    assert [room.family for room in rooms[1:8:2]] == ["T1", "T2", "T3", "T4"]
    assert {room.family for room in [*rooms[:8:2], rooms[8]]} == {"household"}
    assert len({room.name for room in rooms}) == 9 and len({room.entropy for room in rooms}) == 9
    assert drawn(62000, 5, 4) == rooms and rooms[::2] == drawn(62000, 6, 0)[:5]
    assert [room.seed for room in drawn(62000, 204, 0)].count(62001) == 102


def test_what_is_measured_is_kept_and_only_the_rest_is_measured(tmp_path: Path) -> None:
    told: list[Any] = []

    def measured(room: DrawnRoom) -> dict[str, Any]:
        if room.family == "T2":
            raise KeyboardInterrupt
        return {"room": room.name}

    rooms = drawn(62000, 2, 2)
    with pytest.raises(KeyboardInterrupt):
        list(each_once(tmp_path, "room-B", rooms, measured, told.append))
    assert len(told) == 3
    again = each_once(tmp_path, "room-B", rooms, lambda room: {"room": room.name, "anew": True}, told.append)
    assert ["anew" in result for result in again] == [False, False, False, True]
