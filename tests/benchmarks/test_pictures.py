"""The benchmark's real pictures: their index, their annotations, and how they are fetched."""

from __future__ import annotations

import hashlib
import json
import random
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from benchmarks.pictures.fetch import HERE, INDEX, NotFetched, fetch, file_names, main, pictures

ENTRIES = {entry["id"]: entry for entry in pictures()}
GOAL = re.compile(r"\((?:not \()?(?P<relation>ontop|inside|open) (?P<names>[a-z0-9_ ]+)\)\)?")
PLACES = ("floor", "wall")


def annotation(name: str) -> dict[str, Any]:
    data: dict[str, Any] = json.loads((HERE / "annotations" / f"{name}.json").read_text(encoding="utf-8"))
    return data


def test_enough_pictures_each_with_one_annotation() -> None:
    with_depth = [entry for entry in ENTRIES.values() if "depth" in entry]
    assert len(with_depth) >= 12
    assert len(ENTRIES) - len(with_depth) >= 12
    assert {path.stem for path in (HERE / "annotations").iterdir()} == set(ENTRIES)


def test_spent_pictures_judge_no_more() -> None:
    # Each judging half is run once, then tuned with. Newer pictures judge since.
    halves = tomllib.loads(INDEX.read_text(encoding="utf-8"))["spent"]
    spent = {name for half in halves for name in half}
    assert len(spent) == sum(map(len, halves))
    judging = {name for name, entry in ENTRIES.items() if entry["half"] == "judging"}
    assert spent < set(ENTRIES) and not spent & judging
    # Between two judging halves there is none; one that is there has enough of both kinds.
    for has_depth in (True, False):
        assert not judging or sum(("depth" in ENTRIES[name]) == has_depth for name in judging) >= 6


def test_the_first_halves_are_as_drawn() -> None:
    index = tomllib.loads(INDEX.read_text(encoding="utf-8"))
    drawn_half, *later_halves = index["spent"]
    later = {name for half in later_halves for name in half}
    first = [name for name, entry in ENTRIES.items() if entry["half"] == "tuning" and name not in later]
    for has_depth in (True, False):
        group = sorted(name for name in first if ("depth" in ENTRIES[name]) == has_depth)
        fixed = [name for name in group if name in index["fixed"]]
        drawn = [name for name in group if name not in index["fixed"]]
        random.Random(index["seed"]).shuffle(drawn)
        tuning = {*fixed, *drawn[: len(group) // 2 - len(fixed)]}
        assert set(group) - tuning == set(drawn_half) & set(group)


@pytest.mark.parametrize("name", ENTRIES)
def test_source_is_named(name: str) -> None:
    entry = ENTRIES[name]
    assert entry["licence"]
    assert {"fx", "fy", "cx", "cy", "source"} == set(entry["camera"])
    assert entry["level"]["source"]
    if "repository" in entry:
        assert re.fullmatch("[0-9a-f]{40}", entry["commit"])
    else:
        assert entry["package"] and entry["version"]
    for kind in file_names(entry):
        assert re.fullmatch("[0-9a-f]{64}", entry[kind]["sha256"])
    if "depth" in entry:
        in_metres = entry["depth"]["path"].endswith(".npy")
        assert entry["depth"]["unit_m"] == 1.0 if in_metres else 0.0 < entry["depth"]["unit_m"] <= 0.001


@pytest.mark.parametrize("name", ENTRIES)
def test_boxes_are_in_their_picture_and_supports_exist(name: str) -> None:
    data = annotation(name)
    width, height = data["size_px"]
    assert [width, height] == ENTRIES[name]["size_px"]
    ids = [thing["id"] for thing in data["things"]]
    assert len(set(ids)) == len(ids)
    for thing in data["things"]:
        x0, y0, x1, y1 = thing["box"]
        assert 0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height
        assert min(x1 - x0, y1 - y0) >= 8
        assert thing["label"].strip()
        (support,) = [thing[key] for key in ("on", "inside") if key in thing]
        assert support in PLACES or (support in ids and support != thing["id"])


@pytest.mark.parametrize("name", ENTRIES)
def test_sentences_are_about_things_of_the_picture(name: str) -> None:
    data = annotation(name)
    ids = {thing["id"] for thing in data["things"]}
    assert 1 <= len(data["sentences"]) <= 3
    for wish in data["sentences"]:
        assert wish["sentence"] == wish["sentence"].strip().lower()
        assert wish["possible"] or wish["reason"]
        assert wish["goals"]
        for goal in wish["goals"]:
            for literal in goal:
                found = GOAL.fullmatch(literal)
                assert found, literal
                assert set(found["names"].split()) <= ids


def test_most_sentences_are_possible() -> None:
    wishes = [wish for name in ENTRIES for wish in annotation(name)["sentences"]]
    assert sum(wish["possible"] for wish in wishes) >= 0.9 * len(wishes)


def mirrored(folder: Path, content: bytes, path: str = "data/a.png") -> dict[str, Any]:
    """Write a file into a local copy of a repository, and return its entry."""
    target = folder / "owner" / "things" / "data" / "a.png"
    target.parent.mkdir(parents=True)
    target.write_bytes(content)
    file = {"path": path, "bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    camera = {"fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0, "source": "the test"}
    return {"id": "a", "repository": "owner/things", "commit": "0" * 40, "color": file, "camera": camera}


def test_a_local_copy_is_fetched(tmp_path: Path) -> None:
    entry = mirrored(tmp_path / "mirror", b"picture")
    out = tmp_path / "out"
    out.mkdir()
    assert [path.name for path in fetch(entry, out, tmp_path / "mirror")] == ["a.png", "a_camera.json"]
    assert (out / "a.png").read_bytes() == b"picture"
    assert json.loads((out / "a_camera.json").read_text()) == {"fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0}


def test_another_file_is_not_kept(tmp_path: Path) -> None:
    entry = mirrored(tmp_path / "mirror", b"picture")
    (tmp_path / "mirror/owner/things/data/a.png").write_bytes(b"pictures")
    with pytest.raises(NotFetched, match="another file"):
        fetch(entry, tmp_path, tmp_path / "mirror")
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize("path", ["../a.png", "/etc/a.png", "data/../../a.png"])
def test_paths_stay_inside(tmp_path: Path, path: str) -> None:
    entry = mirrored(tmp_path / "mirror", b"picture", path)
    with pytest.raises(NotFetched, match="no path inside"):
        fetch(entry, tmp_path, tmp_path / "mirror")


def test_nothing_is_fetched_beside_the_annotations(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([str(HERE / "annotations")])
    assert "another folder" in capsys.readouterr().err
