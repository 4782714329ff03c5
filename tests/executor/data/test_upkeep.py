"""Merging, checking and describing stores, by the functions and by the commands."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from executor.cli.app import run
from executor.data import samples
from executor.data.card import card, contents_of, page, shares
from executor.data.formats.store_reader import is_for_validation, stream_of
from executor.data.store import EpisodeStore, StoredEpisode
from executor.data.units import SCHEMA
from executor.data.upkeep import find_flaws, merge
from executor.system.files import content_key, json_text

pytest.importorskip("av")
pytestmark = pytest.mark.physics


@pytest.fixture
def copied(filmed_store: EpisodeStore, tmp_path: Path) -> EpisodeStore:
    """Return two episodes of the store, to be spoiled."""
    store = EpisodeStore(tmp_path / "s")
    store.add_requests(filmed_store.requests())
    for episode in list(filmed_store.episodes())[::2]:
        shutil.copytree(episode.path, store.path / "units" / episode.name)
    return store


def meta_changed(**changes: object) -> Callable[[Path], None]:
    def spoil(unit: Path) -> None:
        meta = json.loads((unit / "unit.json").read_text())
        (unit / "unit.json").write_text(json.dumps({**meta, **changes}))

    return spoil


def cut_samples(unit: Path) -> None:
    arrays = samples.unpacked((unit / "samples.xz").read_bytes())
    (unit / "samples.xz").write_bytes(samples.packed({**arrays, "robot_qpos": arrays["robot_qpos"][:-1]}))


SPOILED: dict[str, tuple[Callable[[Path], None], str]] = {
    "unreadable": (lambda unit: (unit / "unit.json").write_text("{"), "does not say what a unit was"),
    "torn": (lambda unit: (unit / "samples.xz").write_bytes(b"\xfd7zXZ"), "not a whole file|not a file of samples"),
    "missing": (lambda unit: (unit / "samples.xz").unlink(), "its samples are missing"),
    "id": (meta_changed(id="0" * 16), "its id is 0000000000000000, that of its unit is"),
    "short": (cut_samples, "rows of robot_qpos, and says"),
    "count": (meta_changed(samples=3), "and says 3 samples"),
    "names": (meta_changed(object_ids=[]), "and names 0"),
    "key": (lambda unit: meta_changed(task=None)(unit), "unit.json does not have what it should|task"),
    "video": (lambda unit: (unit / "head.mp4").unlink(), "head.mp4 is missing"),
    "no video": (lambda unit: (unit / "head.mp4").write_bytes(b"mp4"), "head.mp4 cannot be read"),
}


@pytest.mark.parametrize("kind", SPOILED)
def test_a_broken_unit_is_found(copied: EpisodeStore, kind: str) -> None:
    assert list(find_flaws(copied)) == []
    spoil, words = SPOILED[kind]
    unit = sorted((copied.path / "units").iterdir())[1]
    spoil(unit)
    found = list(find_flaws(copied))
    assert {flaw.episode for flaw in found} == {unit.name}
    assert any(pytest.importorskip("re").search(words, flaw.what) for flaw in found), found


def test_a_folder_under_another_name_is_found(copied: EpisodeStore) -> None:
    unit = sorted((copied.path / "units").iterdir())[0]
    unit.rename(unit.with_name("T5-062990-009-00000000"))
    (flaw,) = find_flaws(copied)
    assert flaw.what == f"its folder should be named {unit.name}"


def test_stores_are_merged_each_episode_once(filmed_store: EpisodeStore, copied: EpisodeStore, tmp_path: Path) -> None:
    done = merge([copied, filmed_store], tmp_path / "all")
    assert (done.copied, done.same) == (4, 2)
    both = EpisodeStore.open(tmp_path / "all")
    assert [episode.name for episode in both.episodes()] == [episode.name for episode in filmed_store.episodes()]
    assert list(both.requests()) == list(filmed_store.requests())
    for episode in both.episodes():
        for file in episode.path.iterdir():
            assert file.read_bytes() == (filmed_store.path / "units" / episode.name / file.name).read_bytes()
    again = merge([filmed_store], tmp_path / "all")
    assert (again.copied, again.same) == (0, 4)
    # What says no more than that its process crashed gives way to what was made of the same unit elsewhere.
    (spoiled, *_) = copied.episodes()
    meta_changed(ended="crashed")(spoiled.path)
    late = merge([copied, filmed_store], tmp_path / "late")
    assert (late.copied, late.same) == (5, 1)
    assert all(episode.succeeded for episode in EpisodeStore.open(tmp_path / "late").episodes())


@pytest.fixture
def twice(made_store: EpisodeStore, tmp_path: Path) -> EpisodeStore:
    """Return a store in which each motion was made for two requests, one of which keeps sizes that fit anyway.

    Of each pair one id is for training and the other one for validation.
    """
    store = EpisodeStore(tmp_path / "old")
    store.add_requests(made_store.requests())

    def asked(episode: StoredEpisode, version: str) -> dict[str, dict[str, Any]]:
        forms = [{**episode.meta["unit"], "keep_sizes": keeps} for keeps in (False, True)]
        return {content_key(SCHEMA, version, json_text(form)): form for form in forms}

    def is_split(version: str) -> bool:
        ids = (asked(episode, version) for episode in made_store.episodes())
        return all(len({is_for_validation(one) for one in pair}) == 2 for pair in ids)

    version = next(filter(is_split, map(str, count())))
    for episode in made_store.episodes():
        for known_as, unit in asked(episode, version).items():
            folder = store.path / "units" / f"{episode.meta['name']}-{known_as[:8]}"
            shutil.copytree(episode.path, folder)
            meta_changed(unit=unit, id=known_as, version=version)(folder)
    return store


def test_what_is_there_twice_is_named_and_counts_once(
    twice: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [episode.name for episode in twice.episodes()]
    assert len(names) == 4
    assert run(["dataset", "check", str(twice.path), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)["flaws"]
    assert [flaw["episode"] for flaw in told] == names[1::2]
    assert all(f"it repeats {first}" in flaw["what"] for flaw, first in zip(told, names[::2], strict=True))
    out = ["--out", str(tmp_path / "set"), "--format", "zarr"]
    assert run(["dataset", "export", str(twice.path), *out, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert sum(told["episodes"].values()) == 2
    assert told["repeats"] == [list(pair) for pair in zip(names[1::2], names[::2], strict=True)]
    assert run(["dataset", "export", str(twice.path), *out, "--force"]) == 0
    assert f"2 demonstrations left out: {names[1]} repeats {names[0]}" in " ".join(capsys.readouterr().err.split())
    found = contents_of(twice)
    assert (found.made, found.kept, found.repeats) == (4, 2, 2)
    assert "2 more repeat one of these" in page(twice)
    merged = merge([twice], tmp_path / "once")
    assert (merged.copied, merged.same) == (4, 0)
    assert [flaw.episode for flaw in find_flaws(EpisodeStore(tmp_path / "once"))] == names[1::2]


def test_one_motion_is_on_one_side_however_it_is_looked_at(twice: EpisodeStore) -> None:
    for number, unit in enumerate(sorted((twice.path / "units").iterdir())):
        meta_changed(pictures={"lights": number})(unit)
    stream = stream_of(twice)
    sides: dict[str, set[bool]] = {}
    for episode in stream.episodes():
        sides.setdefault(episode.about["state_hash"], set()).add(episode.about["validation"])
    assert stream.found.repeats == () and stream.found.count == 4
    assert [len(side) for side in sides.values()] == [1, 1]
    assert list(find_flaws(twice)) == []


def test_the_contents_are_counted(filmed_store: EpisodeStore) -> None:
    found = contents_of(filmed_store)
    assert (found.made, found.succeeded, found.kept, found.asked) == (4, 4, 4, 2)
    assert found.parts["T5"].seeds == (62990, 62991) and found.views == {"head": 4}
    on_disk = sum(path.stat().st_size for path in (filmed_store.path / "units").rglob("*") if path.is_file())
    assert found.store_bytes == on_disk
    assert found.samples == sum(int(episode.meta["samples"]) for episode in filmed_store.episodes())


def test_the_card_says_how_many_have_pictures(filmed_store: EpisodeStore) -> None:
    found = contents_of(filmed_store)
    assert "Views: head. " in page(filmed_store)
    assert shares(found.views, 9) == "head (4 of 9)" and shares({}, 9) == "none"


def with_starts(store: EpisodeStore, starts: Sequence[dict[str, Any]]) -> EpisodeStore:
    """Return the store's first episode once for each of some starts, which say what else its `unit.json` has."""
    first, *_ = sorted((store.path / "units").iterdir())
    for number, changes in enumerate(starts):
        again = first.with_name(f"{first.name[:-8]}{number:08x}")
        shutil.copytree(first, again)
        meta = json.loads((again / "unit.json").read_text())
        scene = meta["scene"]
        thing = sorted(scene["objects"])[0]
        scene["robot"] = {**scene["robot"], **changes.pop("robot", {})}
        scene["objects"][thing] = {**scene["objects"][thing], **changes.pop("thing", {})}
        meta_changed(scene=scene, state_hash=f"{number:064x}", **changes)(again)
    for unit in (store.path / "units").iterdir():
        if not unit.name.endswith(tuple(f"{number:08x}" for number in range(len(starts)))):
            shutil.rmtree(unit)
    return store


def test_the_card_says_what_differs_and_nothing_else(copied: EpisodeStore) -> None:
    """Whatever was asked for: the units ask for all axes, and only what was drawn counts."""
    asked = {"target": True, "surfaces": True, "lights": True, "cameras": True, "physics": True}
    first, *_ = copied.episodes()
    unit = {**first.meta["unit"], "variation": {**first.meta["unit"]["variation"], **asked}}
    pictures = {"views": {"head": {"size": [64, 48], "T_mount_camera": [1]}}, "lights": {"sun": 1.0}, "surfaces": None}
    store = with_starts(copied, [{"unit": unit, "pictures": pictures} for _ in range(3)])
    label = next(iter(contents_of(store).parts))
    text = page(store)
    assert f"| {label} | motion | 3 in 3 |" in text
    same = (
        "sentence, things in the room, models, sizes, places of things, headings of things, parameters, robot's start"
    )
    assert f"{label}: the same in all 3: {same}, lights, surfaces, cameras." in text
    assert text.count(f"| {label} | ") == 2  # The yield, and the motion.


def test_the_card_says_by_how_much_it_differs(copied: EpisodeStore) -> None:
    views = {"head": {"size": [64, 48]}}
    starts: list[dict[str, Any]] = [
        {"robot": {"yaw": -0.1}, "thing": {"model": "a"}, "pictures": {"views": views, "lights": {"sun": 1.0}}},
        {"robot": {"yaw": 0.25}, "thing": {"model": "b"}, "pictures": {"views": views, "lights": {"sun": 2.0}}},
        {
            "robot": {"yaw": 0.1},
            "drawn": {"physics": {"item_mass": 1.5}},
            "pictures": {"views": views, "lights": {"sun": 1.0}},
        },
        {
            "robot": {"yaw": 0.1},
            "drawn": {"physics": {"item_mass": 0.7}},
            "pictures": {"views": views, "lights": {"sun": 1.0}},
        },
    ]
    store = with_starts(copied, starts)
    text = page(store)
    assert "| robot's start | 3 in 4 | yaw_rad -0.1 to 0.25 |" in text
    assert "| physics | 2 in 4 | item_mass 0.7 to 1.5 |" in text
    assert "| models | 3 in 4 |  |" in text and "| lights | 2 in 4 | sun 1 to 2 |" in text
    said = contents_of(store).to_json()["variety"]
    (variety,) = said.values()
    assert variety["varied"]["robot's start"] == {"values": 3, "ranges": {"yaw_rad": [-0.1, 0.25]}}
    assert "places of things" in variety["same"]


def test_one_demonstration_varies_in_nothing(copied: EpisodeStore) -> None:
    text = page(with_starts(copied, [{}]))
    assert "one demonstration only" in text and "what differs" not in text


def test_failures_are_on_the_card_by_kind(copied: EpisodeStore) -> None:
    unit = sorted((copied.path / "units").iterdir())[0]
    meta_changed(ended="failed", failure={"kind": "slipped", "message": "it fell"})(unit)
    text = card(page(copied), "lerobot")
    assert text.startswith("---\nlicense: apache-2.0\n") and "- LeRobot\n" in text
    assert "| slipped | 1 |" in text and "| all |  |  | 2 | 1 | 50.0 % (1.3 to 98.7) |" in text
    assert "sapien 3.0.3" in text and "cpu" not in text.lower()


def test_the_commands(filmed_store: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store, out = str(filmed_store.path), tmp_path / "set"
    assert run(["dataset", "info", store, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kept"] == 4
    assert run(["dataset", "check", store]) == 0
    assert "4 episodes read, nothing wrong" in capsys.readouterr().err
    assert run(["dataset", "export", store, "--format", "zarr", "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["episodes"]["train"] + told["episodes"]["validation"] == 4 and told["views"] == ["head"]
    assert run(["dataset", "export", store, "--format", "zarr", "--out", str(out)]) == 2
    assert "--force" in capsys.readouterr().err
    assert run(["dataset", "merge", store, "--out", str(tmp_path / "m")]) == 0
    assert run(["dataset", "merge", store, "--out", store]) == 2
    capsys.readouterr()
    assert run(["dataset", "card", store]) == 0
    assert capsys.readouterr().out == card(page(filmed_store))
    assert run(["dataset", "card", store, "--out", str(tmp_path / "card.md")]) == 0
    assert (tmp_path / "card.md").read_text() == card(page(filmed_store))
    assert run(["dataset", "card", store, "--out", str(tmp_path / "card.md")]) == 2
    capsys.readouterr()
    assert run(["dataset", "info", str(tmp_path)]) == 2
    assert "is not a store of episodes" in capsys.readouterr().err


def test_a_flaw_is_a_failure(copied: EpisodeStore, capsys: pytest.CaptureFixture[str]) -> None:
    unit = sorted((copied.path / "units").iterdir())[0]
    (unit / "samples.xz").write_bytes(b"")
    assert run(["dataset", "check", str(copied.path), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["ok"] is False and told["flaws"][0]["episode"] == unit.name and told["episodes"] == 2
