"""The store of episodes: complete or absent, in one order, and nobody else's files touched."""

from __future__ import annotations

from pathlib import Path

import pytest

from executor.datasets.store import INDEX, META, EpisodeStore, NotADataset, pending
from executor.datasets.units import DemoSeries, DemoUnit, Origin, Recording

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
    half = folder / "units" / ".part-T1-000008-1234-99"
    half.mkdir()
    assert [episode.name for episode in store.episodes()] == [FIRST.folder("v")]
    store.tidy(3600.0)
    assert half.exists()  # Somebody may be at work in it.
    store.tidy(0.0)
    assert not half.exists() and len(list(store.episodes())) == 1


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
    assert list(pending(store, [SERIES], "v")) == [third]
    assert list(pending(store, [SERIES], "v", again=True)) == [second, third]
    assert list(pending(store, [SERIES], "another program")) == [first, second, third]


def test_another_recording_is_another_unit() -> None:
    other = DemoUnit(Origin("T1"), 7, recording=Recording(views=("head",)))
    assert other.name == FIRST.name and other.folder("v") != FIRST.folder("v")
    assert DemoUnit.from_json(other.to_json()) == other


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
