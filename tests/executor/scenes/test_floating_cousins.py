"""Reconstructions with faults: what floats, sinks or leans is brought to what is below it with a note, or refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import bddl
from executor.cli import app
from executor.scenes.digital_cousins import SceneWithNotes, from_cousins
from executor.scenes.validation import issues
from oag import SceneError
from tests.executor.scenes.reconstructions import Thing, thing, write

TABLE = thing("breakfast_table", (0.8, 0.7, 0.72), (0.4, 1.5, 0.36))
TOP_M = 0.72


def mug(bottom_m: float, x: float = 0.5, y: float = 1.4) -> Thing:
    return thing("mug", (0.11, 0.08, 0.09), (x, y, bottom_m + 0.045))


def facts(found: SceneWithNotes) -> set[str]:
    return {bddl.format(fact) for fact in found.scene.facts if isinstance(fact, bddl.Atom)}


@pytest.mark.parametrize(
    ("bottom_m", "note"),
    [
        (TOP_M + 0.01, None),
        (TOP_M + 0.07, "mug_0 was let down by 7 cm onto table_0"),
        (TOP_M + 0.22, "mug_0 was let down by 22 cm onto table_0"),
        (TOP_M - 0.06, "mug_0 was lifted by 6 cm onto table_0"),
    ],
)
@pytest.mark.parametrize("x", [0.5, 0.82], ids=["over the middle", "with its middle beyond the edge"])
def test_what_floats_comes_onto_the_nearest_top_below(
    bottom_m: float, note: str | None, x: float, tmp_path: Path
) -> None:
    found = from_cousins(write(tmp_path, {"table_0": TABLE, "mug_0": mug(bottom_m, x)}))
    assert facts(found) == {"(ontop mug_0 table_0)"} and not issues(found.scene)
    assert [text for text in found.notes if "by" in text and "onto" in text] == ([note] if note else [])


@pytest.mark.parametrize(
    ("things", "said"),
    [
        ({"mug_0": mug(0.45, 1.1)}, "mug_0: is 0.45 m above the floor, the nearest that it could stand on"),
        ({"mug_0": mug(TOP_M + 0.4)}, "mug_0: is 0.40 m above table_0, the nearest that it could stand on"),
        (
            {"mug_0": mug(0.60)},
            "mug_0: is in the box of table_0 and stands on nothing there; it is 0.60 m from the floor",
        ),
        (
            {"mug_0": mug(0.25)},
            "mug_0: is in the box of table_0 and stands on nothing there; it is 0.25 m from the floor",
        ),
    ],
    ids=["beside the table", "far above it", "just below its top", "between its legs"],
)
def test_what_is_near_nothing_is_refused(things: dict[str, Thing], said: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError) as caught:
        from_cousins(write(tmp_path, {"table_0": TABLE, **things}))
    assert said in str(caught.value)


def test_boards_hollows_and_things_on_things_are_below_too(tmp_path: Path) -> None:
    shelf = thing("shelf", (0.32, 0.8, 1.5), (0.0, -1.0, 0.75))
    boards = from_cousins(write(tmp_path, {"shelf_0": shelf})).scene["shelf_0"]
    assert boards.model == "shelf_open"
    objects = {
        "shelf_0": shelf,
        "can_0": thing("can", (0.06, 0.06, 0.11), (0.0, -1.0, 0.20)),
        "sofa_0": thing("sofa", (0.85, 1.5, 0.8), (0.0, 3.5, 0.4)),
        "teddy_bear_0": thing("teddy_bear", (0.10, 0.12, 0.158), (0.3, 3.5, 0.55)),
        "table_0": TABLE,
        "bowl_0": thing("bowl", (0.16, 0.16, 0.06), (0.4, 1.5, TOP_M + 0.03)),
        "apple_0": thing("apple", (0.07, 0.07, 0.07), (0.4, 1.5, TOP_M + 0.055)),
        "plate_0": thing("plate", (0.2, 0.2, 0.02), (0.4, 1.75, TOP_M + 0.01)),
        "orange_0": thing("orange", (0.07, 0.07, 0.07), (0.4, 1.75, TOP_M + 0.15)),
    }
    found = from_cousins(write(tmp_path, objects))
    expected = "can_0 shelf_0", "teddy_bear_0 sofa_0", "bowl_0 table_0", "plate_0 table_0", "orange_0 plate_0"
    assert facts(found) == {*(f"(ontop {pair})" for pair in expected), "(inside apple_0 bowl_0)"}
    assert 0.5 < found.scene["teddy_bear_0"].position[2] - 0.158 / 2 + 0.2 < 0.8, "on the seat, not on the back"


def test_ids_are_made_legal_with_a_note(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path, {"my table": TABLE, "mug": mug(TOP_M)})
    said = "'my table' is called my_table here: ids have letters, digits, '_', '.' and '-'"
    assert from_cousins(path).notes == (said,)
    assert app.run(["scenes", str(path), "--check", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["notes"] == [said]
    assert app.run(["plan", "pick up the mug", "--scene", str(path)]) in (0, 1)
    assert f"note: {said}" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("key", ["robot", "...", "floor"])
def test_an_id_that_no_scene_can_have_is_refused(key: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="the id "):
        from_cousins(write(tmp_path, {"table_0": TABLE, key: mug(TOP_M)}))


def test_a_lean_is_noted(tmp_path: Path) -> None:
    objects = {
        "table_0": thing("breakfast_table", (0.8, 0.7, 0.72), (0.4, 1.5, 0.36), (0.0, 0.14, 0.0)),
        "mug_0": thing("mug", (0.11, 0.08, 0.09), (0.5, 1.4, TOP_M + 0.045), (0.0, 0.14, 0.0)),
        "can_0": thing("can", (0.06, 0.06, 0.11), (0.3, 1.6, TOP_M + 0.055)),
    }
    assert from_cousins(write(tmp_path, objects)).notes == (
        "table_0 leans by 8 degrees: it was set upright",
        "mug_0 leans by 8 degrees: it was set upright",
    )


@pytest.mark.parametrize(("factor", "unit"), [(100, "centimetres"), (1000, "millimetres")])
def test_a_likely_unit_is_named(factor: float, unit: str, tmp_path: Path) -> None:
    objects = {"table_0": dict(TABLE), "mug_0": mug(TOP_M)}
    for one in objects.values():
        one["bbox_extent"] = (factor * np.ravel(one["bbox_extent"])).tolist()
    with pytest.raises(SceneError) as caught:
        from_cousins(write(tmp_path, objects))
    assert str(caught.value).count(f"; {unit}?") == 2


def test_a_number_that_is_none_is_refused_with_its_place(tmp_path: Path) -> None:
    path = write(tmp_path, {"NaN_0": TABLE, "mug_0": mug(TOP_M)})
    lines = path.read_text().splitlines()
    number = next(n for n, line in enumerate(lines) if "0.09" in line)
    lines[number] = lines[number].replace("0.09", "NaN")
    path.write_text("\n".join(lines))
    column = lines[number].index("NaN") + 1
    with pytest.raises(SceneError, match=f"NaN is no JSON number at line {number + 1}, column {column}"):
        from_cousins(path)
