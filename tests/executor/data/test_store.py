"""The store of episodes: complete or absent, in one order, and nobody else's files touched."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from executor.campaign.engine import pending
from executor.campaign.versions import UNORDERED_VERSION
from executor.data.generation import series_of
from executor.data.store import INDEX, META, EpisodeStore, NotADataset, StoredEpisode
from executor.data.units import SCHEMA, DemoSeries, DemoUnit, Origin, Recording, Variation, View
from executor.data.upkeep import Merged, find_flaws, merge, recorded_key
from executor.data.work import Made, Prepared, meta_of
from executor.records import Detour
from executor.rollouts.run_record import with_open_numbers
from executor.scenes.file import scene_for
from executor.system.files import content_key, json_text
from oag import Task, compose
from oag.model.robots import LIFTED, PAPER_ROBOT, UR5
from tests.executor.recordings import invented_rollout

FIRST = DemoUnit(Origin("T1"), 7)
SERIES = DemoSeries(FIRST, 3)


def put(store: EpisodeStore, unit: DemoUnit, ended: str = "succeeded", version: str = "v") -> Path:
    with store.writing(unit, version) as folder:
        store.write(unit, version, {"ended": ended}, folder)
    return store.place(unit, version)


def test_a_unit_is_there_once_it_is_whole(folder: Path) -> None:
    store = EpisodeStore(folder)
    with store.writing(FIRST, "v") as aside:
        assert store.read(FIRST, "v") is None
        store.write(FIRST, "v", {"ended": "succeeded"}, aside)
        assert store.read(FIRST, "v") is None and not list(store.episodes())
    found = store.read(FIRST, "v")
    assert found is not None and found.succeeded and not found.has_samples
    assert [path.name for path in (folder / "units").iterdir()] == [FIRST.folder("v")]


def test_what_is_broken_off_leaves_nothing(folder: Path) -> None:
    store = EpisodeStore(folder)
    with pytest.raises(RuntimeError), store.writing(FIRST, "v") as aside:
        store.write(FIRST, "v", {"ended": "succeeded"}, aside)
        raise RuntimeError
    assert not list((folder / "units").iterdir())


def test_what_a_killed_process_leaves_is_no_episode_and_is_tidied(folder: Path) -> None:
    store = EpisodeStore(folder)
    put(store, FIRST)
    name = replace(FIRST, seed=8).folder("v")
    half = folder / "units" / f".part-{name}-0123abcd"
    half.mkdir()
    assert [episode.name for episode in store.episodes()] == [FIRST.folder("v")]
    store.tidy({FIRST.folder("v")}, 3600.0)
    assert half.exists()  # Somebody may be at work in it.
    store.tidy({name})
    assert not half.exists()
    half.mkdir()
    store.tidy((), 0.0)
    assert [path.name for path in (folder / "units").iterdir()] == [FIRST.folder("v")]


@pytest.mark.parametrize("ended", ["crashed", "timed-out", "error"])
def test_what_was_broken_off_gives_way_to_what_was_made_since(folder: Path, ended: str) -> None:
    store = EpisodeStore(folder)
    (put(store, FIRST, ended) / "head.mp4").touch()
    put(store, FIRST, "failed")
    put(store, FIRST, ended)
    assert [episode.meta["ended"] for episode in store.episodes()] == ["failed"]
    assert [path.name for path in (folder / "units").rglob("*")] == [FIRST.folder("v"), META]


def test_the_same_unit_twice_is_there_once(folder: Path) -> None:
    store = EpisodeStore(folder)
    with store.writing(FIRST, "v") as aside:
        put(store, FIRST, "succeeded")
        store.write(FIRST, "v", {"ended": "later"}, aside)
    assert [episode.meta["ended"] for episode in store.episodes()] == ["succeeded"]


def test_episodes_come_in_the_order_of_their_names_whoever_made_them_first(folder: Path) -> None:
    store = EpisodeStore(folder)
    for unit in reversed(list(SERIES.units())):
        put(store, unit)
    assert [episode.meta["unit"]["seed"] for episode in store.episodes()] == [7, 8, 9]


def test_only_what_is_missing_is_pending(folder: Path) -> None:
    store = EpisodeStore(folder)
    first, second, third = SERIES.units()
    put(store, first), put(store, second, "crashed")
    jobs, others = ([(unit, version) for unit in SERIES.units()] for version in ("v", "another program"))
    assert list(pending(store, jobs)) == [(third, "v")]
    assert list(pending(store, jobs, again=True)) == [(second, "v"), (third, "v")]
    assert list(pending(store, others)) == others


def old_id(said: dict[str, Any], version: str) -> str:
    """Return the id of a request, as programs wrote it."""
    return content_key(SCHEMA, version, json_text(said))


def test_what_has_an_id_of_before_is_not_made_again(folder: Path) -> None:
    unit, said = FIRST, {**FIRST.to_json(), "robot": PAPER_ROBOT.name}
    store, known_as = EpisodeStore(folder), old_id(said, "v")
    place = folder / "units" / unit.folder_of(known_as)
    place.mkdir(parents=True)
    meta = {"schema": SCHEMA, "id": known_as, "name": unit.name, "version": "v", "unit": said, "ended": "crashed"}
    (place / META).write_text(json.dumps(meta))
    assert known_as != unit.id("v")
    assert list(pending(store, [(unit, "v")])) == []
    put(store, unit, "succeeded")  # What only broke off gives way, under whatever id it lies.
    assert [episode.meta["ended"] for episode in store.episodes()] == ["succeeded"]


def test_equal_units_have_equal_ids_and_texts_whatever_python_made_them_of() -> None:
    recording = Recording(np.float64(10), ("wrist", "head"), (np.int64(128), 128))  # type: ignore[arg-type]
    alike = (
        DemoUnit(Origin("T1"), 7, recording=recording, variation=Variation(noise_m=-0.0)),
        DemoUnit(Origin("T1"), np.int64(7), recording=Recording(10, ("head", "wrist"), [128, 128])),  # type: ignore[arg-type]
        DemoUnit.from_json({"origin": {"family": "T1"}, "seed": 7, "recording": {"views": ["wrist", "head"]}}),
    )
    assert len({unit.id("v") for unit in alike}) == len({json.dumps(unit.to_json()) for unit in alike}) == 1
    for other in ({"evolve": 1}, {"recording": {"rate_hz": True}}, {"seed": 7.0}, {"variation": {"noise_m": True}}):
        with pytest.raises(ValueError):
            DemoUnit.from_json({**FIRST.to_json(), **other})


def test_units_of_a_robot_that_keeps_no_order_name_it_and_have_a_version_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = scene_for("open the refrigerator", "kitchen_t1", robot=LIFTED.name)
    (tmp_path / "own.json").write_text(json.dumps(scene.to_json()))
    wanted = {"query": "open the refrigerator", "scene": "own.json", "episodes": 1}
    (own,) = (series.first for series in series_of({"sources": [wanted]}, scene_folder=tmp_path))
    units = (FIRST, replace(FIRST, robot="panda"), replace(FIRST, robot=UR5.name), own)
    assert [unit.robot_name for unit in units] == ["", "panda", "ur5-lift", "panda-lift"]
    before = [unit.id("v") for unit in units]
    monkeypatch.setattr("executor.data.units.UNORDERED_VERSION", UNORDERED_VERSION + 1)
    assert [unit.id("v") == was for unit, was in zip(units, before, strict=True)] == [True, True, False, False]


def test_results_of_earlier_searches_are_readable_and_do_not_count(folder: Path) -> None:
    unit, store = replace(FIRST, robot=UR5.name), EpisodeStore(folder)
    earlier = [content_key(SCHEMA, said, json_text(unit.to_json())) for said in ("v", "v unordered 1")]
    assert set(earlier) <= set(unit.ids("v")) and set(unit.equal_ids("v")).isdisjoint(earlier)
    for known_as in earlier:
        place = folder / "units" / unit.folder_of(known_as)
        place.mkdir(parents=True)
        meta = {"schema": SCHEMA, "id": known_as, "name": unit.name, "version": "v", "unit": unit.to_json()}
        (place / META).write_text(json.dumps({**meta, "ended": "succeeded"}))
    assert list(pending(store, [(unit, "v")])) == [(unit, "v")]


def test_ids_of_earlier_programs_stay_in_a_merged_store(folder: Path, tmp_path: Path) -> None:
    unit, plain, store = replace(FIRST, robot=UR5.name), FIRST, EpisodeStore(folder)
    store.add_requests([])
    # Outcomes of the first differ since, so that both ids count; those of the last are equal.
    earlier = old_id({**plain.to_json(), "robot": PAPER_ROBOT.name}, "v")
    for made, known_as in ((unit, unit.id("v")), (unit, old_id(unit.to_json(), "v")), (plain, earlier)):
        place = folder / "units" / made.folder_of(known_as)
        place.mkdir(parents=True)
        meta = {"schema": SCHEMA, "id": known_as, "name": made.name, "version": "v", "unit": made.to_json()}
        (place / META).write_text(json.dumps({**meta, "ended": "failed"}))
    names, merged = [episode.name for episode in store.episodes()], EpisodeStore(tmp_path / "merged")
    for done in (Merged(copied=3), Merged(same=3)):
        assert merge([store], merged.path) == done
        assert [episode.name for episode in merged.episodes()] == names and not list(find_flaws(merged))
    assert merged.ending(unit, "v") == merged.ending(plain, "v") == "failed"


def test_the_robot_of_a_family_has_one_id_and_that_of_its_name_counts() -> None:
    named = replace(FIRST, robot=PAPER_ROBOT.name, recording=Recording(views=("wrist", "head")))
    plain = replace(named, robot="")
    assert named == plain and named.id("v") == plain.id("v")
    assert old_id({**plain.to_json(), "robot": PAPER_ROBOT.name}, "v") in plain.equal_ids("v")
    of_a_scene = DemoUnit(Origin(None, "open it", "s.json", "k"), 7)
    assert replace(of_a_scene, robot=PAPER_ROBOT.name).id("v") != of_a_scene.id("v")


def test_pictures_of_varied_surfaces_without_a_home_have_a_version_of_their_own() -> None:
    views: tuple[View, ...] = ("head",)
    surfaces = Variation(surfaces=True)
    for recording, variation, own in (
        (Recording(views=views), surfaces, True),
        (Recording(views=views, home=True), surfaces, False),
        (Recording(views=views), Variation(lights=True), False),
        (Recording(), surfaces, False),
    ):
        unit = replace(FIRST, recording=recording, variation=variation)
        before = old_id(unit.to_json(), "v")
        assert before in unit.ids("v") and (before not in unit.equal_ids("v")) is own


def test_a_scene_without_doors_has_a_key_of_its_content() -> None:
    names = ("packed_states", "time_s", "subtask", "step", "robot_qpos", "robot_qvel", "robot_target", "eef_pose")
    arrays = {name: np.ones((3, 2)) for name in (*names, "object_poses")} | {"joint_positions": np.empty((3, 0))}
    one, other = (
        cast("StoredEpisode", SimpleNamespace(meta={"query": "pick up the mug"}, arrays=arrays | more))
        for more in ({}, {"joint_positions": np.ones((3, 1))})
    )
    assert recorded_key(one) != recorded_key(other)


def test_another_recording_is_another_unit() -> None:
    other = DemoUnit(Origin("T1"), 7, recording=Recording(views=("head",)))
    assert other.name == FIRST.name and other.folder("v") != FIRST.folder("v")
    assert DemoUnit.from_json(other.to_json()) == other


def test_each_axis_is_drawn_of_its_own_for_each_family_and_seed() -> None:
    units = [FIRST, replace(FIRST, origin=Origin("T2")), replace(FIRST, seed=8)]
    units += [DemoUnit(Origin("T5"), 7, 0), DemoUnit(Origin("T5"), 7, 1), DemoUnit(Origin(None, "open it", "s"), 7)]
    drawn = [unit.draws(axis).random() for unit in units for axis in ("surfaces", "lights")]
    assert len(set(drawn)) == len(drawn)
    # Nor does what is recorded, or what else varies, change it.
    other = replace(FIRST, recording=Recording(views=("head",)), variation=Variation(lights=True))
    assert other.draws("lights").random() == FIRST.draws("lights").random() == other.looks("lights").random()


def test_units_that_cannot_be_are_refused() -> None:
    for wrong in ({"index": 3}, {"origin": {"family": "T5"}}, {"origin": {}}, {"seed": -1}, {"flows": "mine"}):
        with pytest.raises(ValueError):
            DemoUnit.from_json({**FIRST.to_json(), **wrong})


def test_requests_are_kept_once_and_in_order(folder: Path) -> None:
    store = EpisodeStore(folder)
    store.add_requests([{"a": 1}, {"b": 2}])
    store.add_requests([{"a": 1}, {"c": 3}])
    assert [*EpisodeStore.open(folder).requests()] == [{"a": 1}, {"b": 2}, {"c": 3}]


@pytest.mark.parametrize("index", ["", "{}", '{"schema": "other"}', "[]", '{"schema": "scene2demo-dataset/1"}'])
def test_a_folder_of_something_else_is_refused_and_left_alone(folder: Path, index: str) -> None:
    folder.mkdir()
    (folder / INDEX).write_text(index)
    with pytest.raises(NotADataset):
        EpisodeStore(folder).add_requests([{"a": 1}])
    assert (folder / INDEX).read_text() == index


def test_files_of_something_else_are_left_alone(folder: Path) -> None:
    folder.mkdir()
    (folder / "thesis.tex").write_text("x")
    with pytest.raises(NotADataset, match="something else"):
        EpisodeStore(folder).add_requests([{"a": 1}])


def test_an_episode_that_cannot_be_read_is_named(folder: Path) -> None:
    store = EpisodeStore(folder)
    place = put(store, FIRST)
    (place / META).write_text("{")
    assert store.read(FIRST, "v") is None
    with pytest.raises(NotADataset, match=place.name):
        list(store.episodes())


def test_what_is_asked_for_again_is_there_once(folder: Path) -> None:
    store = EpisodeStore(folder)
    store.add_requests([SERIES.to_json(), SERIES.to_json()])
    store.add_requests([SERIES.to_json(), *store.requests()])
    assert len(store.requests()) == 1


def test_a_unit_certifies_the_plan_that_it_has_with_its_numbers_and_what_was_inserted() -> None:
    done = replace(invented_rollout(), detours=(Detour(0, 1, "the door was shut"),))
    asked = compose(with_open_numbers(done.asked_for), scene=done.scene)
    meta = meta_of(Made(Prepared("pick up the glass", asked), asked, done))
    certificate = compose(Task.from_json(meta["task"], scene=done.scene)).verify().certificate
    assert certificate is not None and meta["certificate"] == certificate.task_hash
    assert meta["detours"] == [{"first": 0, "count": 1, "reason": "the door was shut"}]
