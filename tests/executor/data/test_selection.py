"""What a store has is exported whole, or a refusal says what to choose; nothing is left out without a word."""

from __future__ import annotations

import json
import re
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from executor.cli.app import run
from executor.data.episode import FAILURE
from executor.data.formats.export import FORMATS, Format
from executor.data.formats.selection import BadSelection, NothingToExport, Selection
from executor.data.formats.store_reader import stream_of
from executor.data.store import EpisodeStore
from executor.data.upkeep import merge
from executor.data.views import footage_path

pytest.importorskip("h5py")
pytest.importorskip("pyarrow")
pytest.importorskip("av")
pytestmark = pytest.mark.physics


def changed(unit: Path, **values: Any) -> None:
    path = unit / "unit.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **values}))


@pytest.fixture
def mixed(made_store: EpisodeStore, filmed_store: EpisodeStore, tmp_path: Path) -> EpisodeStore:
    """Return two episodes without pictures, three with the head's, one with the head's and the wrist's."""
    store = EpisodeStore(tmp_path / "mixed")
    merge([made_store, filmed_store], store.path)
    unit = next(episode.path for episode in store.episodes() if episode.meta.get("pictures"))
    for kind in ("", "depth"):
        shutil.copy(footage_path(unit, "head", kind), footage_path(unit, "wrist", kind))
    pictures = json.loads((unit / "unit.json").read_text())["pictures"]
    changed(unit, pictures={**pictures, "views": {**pictures["views"], "wrist": pictures["views"]["head"]}})
    return store


def refusal(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert run(["dataset", "export", *words]) == 2
    return " ".join(capsys.readouterr().err.split())


@pytest.mark.slow
@pytest.mark.parametrize("kind", FORMATS)
def test_a_mixed_store_says_what_to_choose_and_each_choice_gives_what_it_says(
    mixed: EpisodeStore, kind: Format, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(mixed.path), "--format", kind, "--out"]
    said = refusal([*words, str(tmp_path / "no")], capsys)
    assert "3 have head, 2 have none, 1 have head and wrist" in said and not (tmp_path / "no").exists()
    choices = dict(re.findall(r"(\d+) with --only (\S+?)[,;]? ", said))
    assert choices == {"4": "views=head", "1": "views=head+wrist", "6": "views=none"}
    if kind != "robomimic":
        choices = {"4": "views=head"}
    for number, (count, only) in enumerate(choices.items()):
        if only.endswith("wrist"):
            continue  # This store has no poses of that camera.
        out = tmp_path / f"set{number}"
        assert run(["dataset", "export", *words, str(out), "--only", only, "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["views"] == [view for view in only.removeprefix("views=").split("+") if view != "none"]
        assert told["episodes"]["train"] + told["episodes"]["validation"] == int(count)
        assert f"`{only}`, {count} episodes" in (out / "README.md").read_text()


def test_origins_and_endings_are_chosen(mixed: EpisodeStore, made_store: EpisodeStore) -> None:
    origins = Counter(episode.meta["unit"]["origin"]["family"] for episode in mixed.episodes())
    assert origins == {"T5": 3, "T6": 3}
    only = stream_of(mixed, only=Selection.parse("origin=T5,views=none"))
    assert {one.about["unit"]["origin"]["family"] for one in only.episodes()} == {"T5"} and only.found.count == 3
    assert stream_of(mixed, only=Selection.parse("views=none, origin=T6+T5")).found.count == 6
    unit = next(episode.path for episode in mixed.episodes() if not episode.meta.get("pictures"))
    changed(unit, ended="failed", failure={"kind": "slipped", "message": "it fell"})
    assert stream_of(mixed, only=Selection.parse("views=none")).found.count == 5
    assert stream_of(mixed, only=Selection.parse("views=none,ended=succeeded+failed")).found.count == 6
    (failed,) = stream_of(mixed, only=Selection.parse("ended=failed")).episodes()
    assert failed.about["kind"] == FAILURE and failed.about["failure"]["kind"] == "slipped"
    assert not failed.columns["next.reward"].any() and failed.columns["next.done"][-1]


@pytest.mark.parametrize(
    ("only", "words"),
    [
        ("orgin=T5", "episodes have no 'orgin': expected with a key out of episode (its folder's name"),
        ("T5", "'T5' chooses nothing: expected KEY=VALUE"),
        ("origin=", "'origin=' chooses nothing"),
        ("origin=T5,origin=T6", "origin is there twice"),
        ("origin=T9", "has no origin T9: it has T5, T6"),
        ("views=heads", "has no views heads: it has head, wrist, or none"),
        ("views=none+head", "views=none stands alone"),
        ("views=none,size=64x48", "views=none leaves no pictures that have size"),
        ("ended=crashed", "has no ended crashed: it has failed, succeeded"),
        ("rate=20", "has no rate 20: it has 10"),
        ("robot=1", "has no robot 1: it has 0.7"),
        ("size=128x128", "has no size 128x128: it has 64x48"),
        ("channels=rgb", "has no channels rgb: it has depth, segmentation"),
        ("ended=failed", "no episode of"),
        ("views=wrist,channels=segmentation", "its motions have origin T5 (3), T6 (3); ended succeeded (6);"),
    ],
)
def test_what_cannot_be_chosen_is_refused_with_what_can(
    mixed: EpisodeStore, only: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert words in refusal([str(mixed.path), "--only", only, "--out", str(tmp_path / "out")], capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"record_hz": 20.0}, "5 with --only views=none,rate=10, or 1 with --only views=none,rate=20.8333"),
        ({"robot": 1.0}, "5 with --only views=none,robot=0.7, or 1 with --only views=none,robot=1"),
    ],
)
def test_rates_and_robots_are_chosen_too(mixed: EpisodeStore, values: dict[str, Any], words: str) -> None:
    episode = next(mixed.demonstrations())
    if "robot" in values:
        values = {"robot": {**episode.meta["robot"], "scale": 1.0}}
    changed(episode.path, **values)
    with pytest.raises(NothingToExport, match=re.escape(words)):
        stream_of(mixed, only=Selection.parse("views=none"))
    for choice in re.findall(r"--only (\S+?)(?:,? |$)", words):
        assert stream_of(mixed, only=Selection.parse(choice.rstrip(","))).found.count in (1, 5)


def test_sizes_of_pictures_are_chosen_too(filmed_store: EpisodeStore, tmp_path: Path) -> None:
    store = EpisodeStore(Path(shutil.copytree(filmed_store.path, tmp_path / "s")))
    changed(next(store.episodes()).path, pictures={"views": {"head": {"size": [128, 96]}}})
    with pytest.raises(NothingToExport, match=r"export 3 with --only size=64x48, or 1 with --only size=128x96"):
        stream_of(store)
    assert stream_of(store, only=Selection.parse("size=64x48")).found.views == {"head": (64, 48)}
    assert stream_of(store, only=Selection.parse("views=head,size=128x96")).found.count == 1


def test_depth_that_not_all_have_is_asked_for_in_vain_or_chosen(filmed_store: EpisodeStore, tmp_path: Path) -> None:
    store = EpisodeStore(Path(shutil.copytree(filmed_store.path, tmp_path / "s")))
    footage_path(next(store.episodes()).path, "head", "depth").unlink()
    with pytest.raises(
        NothingToExport, match=r"1 of 4 episodes .* have no depth; export without --include depth, or 3"
    ):
        stream_of(store, ("depth",))
    chosen = stream_of(store, ("depth",), Selection.parse("channels=depth"))
    assert chosen.found.count == 3 and chosen.found.channels == ("depth",)
    assert stream_of(store).found.count == 4
    with pytest.raises(NothingToExport, match=r"4 of 4 .* have no depth; export without --include depth"):
        stream_of(store, ("depth",), Selection.parse("views=none"))


def test_a_policy_learns_from_a_mixed_store(mixed: EpisodeStore) -> None:
    windows = pytest.importorskip("executor.learn.demonstrations")
    assert windows.learned_from(mixed.path).demonstrations == 6


def test_a_choice_says_itself() -> None:
    for text in ("", "origin=T5+T6,views=head", "ended=failed,rate=10,robot=0.7,size=64x48"):
        assert Selection.parse(text).text == text
    assert Selection.parse("rate=10.0").text == "rate=10"
    with pytest.raises(BadSelection):
        Selection.parse("views=head+head")
