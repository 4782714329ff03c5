"""The audit finds every spoiled episode and agrees with the clean ones."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from executor.audit import checks
from executor.audit.checks import Finding
from executor.audit.episodes import EpisodeVerdict, audit_episode, audit_store, kept_verdict
from executor.cli.app import run
from executor.data.formats.selection import Selection
from executor.data.formats.store_reader import stream_of
from executor.data.store import META, EpisodeStore, StoredEpisode
from executor.data.units import DemoUnit
from executor.sim.world import World
from executor.view.stores import StoreListing
from tests.executor.audit.spoilers import (
    SPOILERS,
    Spoiler,
    goal_negated,
    sentence_verb,
    spoil,
    spoiled,
    start_floats,
    state_aside,
)

pytestmark = pytest.mark.physics
EACH = 12
"""Spoiled episodes of each kind."""

SHOWN_BY = {
    "state": {"states", "false-success", "moving", "unstable"},
    "goal": {"sentence", "plan"},
    "sentence": {"sentence"},
    "asset": {"asset"},
    "start": {"start-goal", "start-moves", "start-fallen", "start-elsewhere", "start-overlap"},
}


def test_clean_episodes_are_sound_also_when_they_are_repeated(clean: EpisodeStore) -> None:
    episodes = list(clean.demonstrations())
    assert len(episodes) == 2
    for episode in episodes:
        assert audit_episode(episode) == EpisodeVerdict(episode.name, "sound", replayed=True)


@pytest.mark.parametrize(
    ("kind", "spoiler"),
    [("state", state_aside), ("goal", goal_negated), ("sentence", sentence_verb), ("start", start_floats)],
)
def test_a_spoiled_episode_is_found_without_repeating_it(
    kind: str, spoiler: object, clean: EpisodeStore, tmp_path: Path
) -> None:
    for number, episode in enumerate(clean.demonstrations()):
        found = audit_episode(spoil(episode, spoiler, 0, tmp_path / str(number)), with_replay=False)  # type: ignore[arg-type]
        assert found.verdict == "flawed" and set(found.kinds) & SHOWN_BY[kind], found


def recorded_of(episode: StoredEpisode, spoiler: Spoiler = lambda record: None) -> checks.Recorded:
    record, unit = spoiled(episode, spoiler, 0), DemoUnit.from_json(episode.meta["unit"])
    return checks.Recorded(unit, episode.scene, episode.task, record.meta, record.arrays, begins_midway=False)


def test_every_column_is_compared_with_the_states(clean: EpisodeStore) -> None:
    episode = next(each for each in clean.demonstrations() if each.meta["joint_ids"])
    columns = [spoiler for spoiler in SPOILERS["state"] if spoiler.__name__.startswith("column")]
    assert len(columns) == 6
    with World(episode.scene) as world:
        assert not list(checks.states(recorded_of(episode), world))
        for spoiler in columns:
            found = list(checks.states(recorded_of(episode, spoiler), world))
            assert [finding.kind for finding in found] == ["states"], spoiler.__name__


def test_a_takeover_that_begins_with_the_thing_in_the_hand_lifts_it_from_the_scene(clean: EpisodeStore) -> None:
    episode = next(each for each in clean.demonstrations() if "gripper" in each.meta["task"]["goal"])
    whole = recorded_of(episode)
    late = replace(whole, arrays={name: values[-2:] for name, values in whole.arrays.items()})
    with World(episode.scene) as world:
        scene_start = world.pack()
        assert "false-success" in {finding.kind for finding in checks.end(late, world, scene_start)}
        assert not list(checks.end(replace(late, begins_midway=True), world, scene_start))


def test_an_error_of_the_engine_costs_one_episode(clean: EpisodeStore, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> Iterator[Finding]:
        raise RuntimeError("the engine ends")

    monkeypatch.setattr("executor.audit.checks.record", broken)
    found = [audit_episode(episode, with_replay=False) for episode in clean.demonstrations()]
    assert [verdict.kinds for verdict in found] == [("unreadable",)] * 2


@pytest.mark.slow
def test_sixty_spoiled_episodes_are_all_found_without_repeating_them(more: EpisodeStore, tmp_path: Path) -> None:
    episodes = list(more.demonstrations())
    found: Counter[str] = Counter()
    for kind, spoilers in SPOILERS.items():
        for number in range(EACH):
            spoiler = spoilers[number % len(spoilers)]
            # Steps of 7 meet every pair of a spoiler and an episode.
            episode = episodes[(number // len(spoilers) + 7 * number) % len(episodes)]
            verdict = audit_episode(spoil(episode, spoiler, number, tmp_path / f"{kind}-{number}"), with_replay=False)
            assert verdict.verdict == "flawed", (spoiler.__name__, episode.name)
            assert set(verdict.kinds) & SHOWN_BY[kind], (spoiler.__name__, episode.name, verdict)
            found[kind] += 1
    assert found == dict.fromkeys(SPOILERS, EACH)


@pytest.mark.slow
def test_a_changed_state_is_found_by_its_commands_alone(clean: EpisodeStore, tmp_path: Path) -> None:
    episode = next(clean.demonstrations())
    verdict = audit_episode(spoil(episode, state_aside, 0, tmp_path / "s"))
    assert "replay" in verdict.kinds


def test_verdicts_are_kept_in_the_store_and_exported_until_the_episode_changes(
    clean: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s"
    shutil.copytree(clean.path, path)
    store = EpisodeStore(path)
    assert [row.audited for row in StoreListing(path).rows()] == ["", ""]
    assert run(["dataset", "audit", str(path), "--no-replay", "--workers", "1", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["audited"] == answer["sound"] == 2 and answer["kinds"] == {} and answer["left_out"] == 0
    assert [row.audited for row in StoreListing(path).rows()] == ["sound", "sound"]
    exported = list(stream_of(store, only=Selection.parse("audited=sound")).episodes())
    assert [each.about["audited"] for each in exported] == [{"verdict": "sound", "kinds": [], "replayed": False}] * 2
    # A second run reads what is there.
    assert [verdict.verdict for verdict in audit_store(store, with_replay=False)] == ["sound", "sound"]
    first = next(store.episodes())
    meta = json.loads((first.path / META).read_text(encoding="utf-8"))
    meta["query"] = "close the window"
    (first.path / META).write_text(json.dumps(meta), encoding="utf-8")
    assert kept_verdict(store.episode(first.name)) is None
    assert run(["dataset", "audit", str(path), "--no-replay", "--workers", "1"]) == 1
    said = capsys.readouterr()
    assert "1 of 2 episodes sound" in said.out and "1 x sentence" in said.out
    assert "--only audited=sound" in said.out
