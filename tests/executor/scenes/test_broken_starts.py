"""Scenes that begin broken: what leans, lies, hangs over an edge or is turned by a misread quaternion is named."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from executor.assets.importers.importer import import_asset
from executor.cli import app
from executor.data.generation import series_of
from executor.rollouts.checkpoint import Checkpoint, StartUnstable
from executor.scenes.file import load_scene
from oag import SceneError

Entry = dict[str, Any]
TABLE: Entry = {"category": "table", "position": [1.2, 0.0, 0.35], "bbox_extent": [0.8, 0.7, 0.70]}


def about(axis: str, degrees: float) -> list[float]:
    """A quaternion w x y z."""
    half = math.radians(degrees) / 2
    return [math.cos(half), *(math.sin(half) if name == axis else 0.0 for name in "xyz")]


def w_last(quaternion: list[float]) -> list[float]:
    return [*quaternion[1:], quaternion[0]]


def can(x: float, y: float, bottom_m: float = 0.70, **more: Any) -> Entry:
    return {"category": "can", "position": [x, y, bottom_m + 0.05], "bbox_extent": [0.06, 0.06, 0.10], **more}


def written(folder: Path, objects: dict[str, Entry], **more: Any) -> Path:
    path = folder / "broken.json"
    path.write_text(json.dumps({"name": "broken", "robot": {"position": [0, 0]}, "objects": objects, **more}))
    return path


def checked(folder: Path, objects: dict[str, Entry], capsys: pytest.CaptureFixture[str]) -> tuple[list[str], list[str]]:
    """The errors and the warnings of `--check`."""
    code = app.run(["scenes", str(written(folder, objects)), "--check", "--json"])
    said = json.loads(capsys.readouterr().out)
    assert code == (2 if said["errors"] else 0)
    return said["errors"], said["warnings"]


@pytest.mark.parametrize(
    ("orientation", "how"),
    [
        (about("x", 17), "can_0 leans by 17 degrees"),
        (about("y", -60), "can_0 leans by 60 degrees"),
        (about("y", 90), "can_0 lies on its side"),
        (about("x", 178), "can_0 is upside down"),
        (about("x", 3), None),
    ],
)
def test_an_item_that_does_not_stand_is_a_warning(
    orientation: list[float], how: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # As high as its lowest corner asks for.
    _, x, y, _ = orientation
    up = abs(1.0 - 2.0 * (x * x + y * y))
    half_m = 0.05 * up + 0.03 * math.sqrt(1.0 - up * up)
    thing = can(1.2, 0.0, 0.70 + half_m - 0.05, orientation=orientation)
    errors, warnings = checked(tmp_path, {"table_0": TABLE, "can_0": thing}, capsys)
    assert not errors
    assert [how] == [warning.split(";")[0] for warning in warnings] if how else not warnings


def test_of_a_ball_nothing_leans(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ball = {"category": "apple", "position": [1.2, 0.0, 0.735], "bbox_extent": [0.07, 0.07, 0.07]}
    assert checked(tmp_path, {"table_0": TABLE, "apple_0": {**ball, "orientation": about("x", 70)}}, capsys) == ([], [])


def test_furniture_that_leans_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    chair = {"category": "chair", "position": [0.5, 1.5, 0.5], "orientation": about("y", 30)}
    errors, _ = checked(tmp_path, {"table_0": TABLE, "chair_0": chair}, capsys)
    assert "chair_0 leans by 30 degrees; furniture has to stand upright" in errors


@pytest.mark.parametrize(
    ("x", "y", "said", "error"),
    [
        (0.775, 0.1, "can_0 stands with its middle beyond the edge of table_0 by 2.5 cm: it will fall", True),
        (1.2, 0.355, "can_0 stands with its middle beyond the edge of table_0 by 0.5 cm: it will fall", False),
        (1.2, -0.348, "can_0 stands with its middle 0.2 cm within the edge of table_0: it may fall", False),
        (1.2, 0.33, "", False),
    ],
)
def test_what_stands_over_an_edge_is_named(
    x: float, y: float, said: str, error: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    errors, warnings = checked(tmp_path, {"table_0": TABLE, "can_0": can(x, y)}, capsys)
    assert (errors, warnings) == (([said], []) if error else ([], [said] if said else []))


def test_the_corner_of_a_round_table_s_box_is_no_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = {**TABLE, "model": "table_round", "bbox_extent": [0.8, 0.8, 0.70]}
    errors, _ = checked(tmp_path, {"table_0": table, "can_0": can(1.51, 0.31)}, capsys)
    assert errors == ["can_0 stands with its middle beyond the edge of table_0 by 3.8 cm: it will fall"]


def test_an_imported_top_that_is_not_quite_level_carries_things(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SCENE2DEMO_ASSETS", str(tmp_path / "assets"))
    slab = trimesh.creation.box((0.8, 0.7, 0.7))
    slab.vertices[slab.vertices[:, 0] > 0, 2] += np.where(slab.vertices[slab.vertices[:, 0] > 0, 2] > 0, 0.004, 0.0)
    slab.export(tmp_path / "slab.stl")
    extent = import_asset(tmp_path / "slab.stl", "slab", category="table").stored.asset.extent_m
    table = {"category": "table", "model": "imported/slab", "position": [1.2, 0.0, extent[2] / 2]}
    errors, _ = checked(tmp_path, {"table_0": table, "can_0": can(1.5, 0.2, 0.703)}, capsys)
    assert errors == []
    errors, _ = checked(tmp_path, {"table_0": table, "can_0": can(1.62, 0.2, 0.704)}, capsys)
    assert len(errors) == 1 and "can_0 stands with its middle beyond the edge of table_0" in errors[0]


def test_a_box_across_a_gap_between_two_tables_stands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = {**TABLE, "position": [1.2, 0.78, 0.35]}
    box = {"category": "box", "position": [1.2, 0.39, 0.75], "bbox_extent": [0.14, 0.18, 0.1]}
    assert checked(tmp_path, {"table_0": TABLE, "table_1": other, "box_0": box}, capsys)[0] == []


@pytest.mark.parametrize(("bottom_m", "where"), [(0.692, "warning"), (0.697, ""), (0.67, "error")])
def test_what_is_in_a_top_is_named(
    bottom_m: float, where: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    errors, warnings = checked(tmp_path, {"table_0": TABLE, "can_0": can(1.2, 0.1, bottom_m)}, capsys)
    assert bool(errors) is (where == "error")
    assert [f"can_0 is {100 * (0.70 - bottom_m):.1f} cm deep in the top of table_0; physics will push it out"] == (
        warnings
    ) or where != "warning"
    assert bool(warnings) is (where == "warning")


@pytest.mark.parametrize(
    "turns",
    [
        {"table_0": about("z", 90), "can_0": about("z", 0)},
        {"table_0": about("z", 0), "can_0": about("z", 35)},
        {"table_0": about("z", -20), "can_0": about("x", 90)},
    ],
    ids=["furniture lies", "only an item leans", "beside a thing that is meant to lie"],
)
def test_quaternions_with_w_last_are_recognised(
    turns: dict[str, list[float]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    right: dict[str, Entry] = {"table_0": TABLE, "can_0": can(1.2, 0.0)}
    swapped = {key: {**entry, "orientation": w_last(turns[key])} for key, entry in right.items()}
    hint = "scene has quaternions that look like x y z w: all furniture would be upright then; expected w x y z"
    assert hint in checked(tmp_path, swapped, capsys)[0]
    meant = {key: {**entry, "orientation": turns[key]} for key, entry in right.items()}
    assert not any("x y z w" in line for lines in checked(tmp_path, meant, capsys) for line in lines)


def test_no_turn_with_w_last_is_half_a_turn_of_everything(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    objects = {"table_0": TABLE, "can_0": can(1.2, 0.0)}
    turned = {key: {**entry, "orientation": [0, 0, 0, 1]} for key, entry in objects.items()}
    errors, warnings = checked(tmp_path, turned, capsys)
    assert (
        not errors and len(warnings) == 1 and warnings[0].startswith("scene has the quaternion 0 0 0 1 for everything")
    )


@pytest.mark.parametrize(
    ("quaternion", "length"), [([0.5, 0, 0, 0.2], "0.539"), ([2, 0, 0, 0], "2"), ([0.7, 0, 0, 0.7], "")]
)
def test_a_quaternion_that_is_not_of_length_one_is_a_warning(
    quaternion: list[float], length: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    errors, warnings = checked(tmp_path, {"can_0": can(1.0, 0.0, 0.0, orientation=quaternion)}, capsys)
    said = f"objects.can_0.orientation: is a quaternion of length {length}, expected 1; it was divided by its length"
    assert (errors, warnings) == ([], [said] if length else [])


def test_commands_print_warnings_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lying = can(1.2, 0.2, 0.68, orientation=about("x", 90))
    scene = written(tmp_path, {"table_0": TABLE, "can_0": can(1.0, 0.0, orientation=[2, 0, 0, 0]), "can_1": lying})
    assert app.run(["plan", "pick up can_0", "--scene", str(scene)]) in (0, 1)
    told = " ".join(capsys.readouterr().err.split())
    assert "warning: can_1 lies on its side" in told and "orientation: is a quaternion of length 2" in told


def test_no_data_set_is_planned_in_a_scene_that_cannot_be(tmp_path: Path) -> None:
    scene = written(tmp_path, {"table_0": TABLE, "can_0": can(0.78, 0.1)})
    with pytest.raises(SceneError, match="can_0 stands with its middle beyond the edge of table_0"):
        series_of({"sources": [{"query": "pick up the can", "scene": str(scene)}]})


@pytest.mark.physics
@pytest.mark.parametrize(
    ("x", "turn", "holds"),
    [
        (1.2, about("x", 45), False),
        (0.795, about("x", 0), False),
        (1.2, about("x", 90), True),
        (1.2, about("x", 0), True),
    ],
    ids=["leans", "over the edge", "lies", "stands"],
)
def test_no_episode_begins_with_a_thing_that_falls(x: float, turn: list[float], holds: bool, tmp_path: Path) -> None:
    """Whatever positions tell, physics decides: no success of such a scene can be kept."""
    half_m = 0.05 * abs(math.cos(2 * math.acos(turn[0]))) + 0.03 * abs(math.sin(2 * math.acos(turn[0])))
    thing = can(x, 0.0, 0.70 + half_m - 0.05, orientation=turn)
    scene = load_scene(written(tmp_path, {"table_0": TABLE, "can_0": thing}))
    if holds:
        Checkpoint.at_start(scene)
    else:
        with pytest.raises(StartUnstable, match=r"can_0 moves by \d+ cm and tips by \d+ degrees"):
            Checkpoint.at_start(scene)
