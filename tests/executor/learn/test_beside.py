"""Drives as seen from beside: robot, hand and what that holds move together, and all else stays."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from executor.data.episode import Episode
from executor.data.formats.export import open_set
from executor.data.state_readers import THING, StateReader
from executor.data.store import EpisodeStore
from executor.learn.demonstrations import read_demonstrations
from executor.learn.observations import offset_drives
from executor.learn.settings import SettingsError, settings_of
from executor.sim.world import World
from oag.model.symbols import Primitive
from tests.executor.learn.conftest import small

pytestmark = pytest.mark.physics

STATE, AROUND = "observation.state", "observation.environment_state"


@pytest.fixture(scope="module")
def episode(picked: EpisodeStore) -> Episode:
    """Return a demonstration of picking up."""
    return next(iter(open_set(picked.path, ()).episodes()))


@pytest.mark.slow
def test_the_robot_is_where_its_joints_say_and_the_room_is_where_it_was(picked: EpisodeStore, episode: Episode) -> None:
    drives = episode.columns["primitive_index"] == Primitive.NAVIGATE_TO_TARGET.value
    found = offset_drives(episode.columns, drives, np.zeros_like(drives), 0.05, np.random.default_rng(0))
    moved = (found[STATE] != episode.columns[STATE]).any(axis=1)
    assert 0.2 < moved[drives].mean() < 0.8 and not moved[~drives].any()
    assert (found[AROUND] == episode.columns[AROUND]).all()
    off_m = np.linalg.norm((found[STATE] - episode.columns[STATE])[moved, :2], axis=1)
    assert 0.02 < np.median(off_m) < 0.12
    stored = next(picked.demonstrations())
    with World(stored.scene) as world:
        reader = StateReader(world, stored.task)
        for row in np.flatnonzero(moved):
            world.robot.set_qpos(found[STATE][row, :12].astype(float))
            told, seen = reader.agent(), found[STATE][row]
            assert told[:15] == pytest.approx(seen[:15], abs=1e-4)
            turn = Rotation.from_quat(told[15:19]).inv() * Rotation.from_quat(seen[15:19])
            assert turn.magnitude() < 1e-3


@pytest.mark.slow
def test_what_is_held_moves_along(episode: Episode) -> None:
    count = episode.length
    columns = {name: np.array(column) for name, column in episode.columns.items()}
    columns[AROUND][:, 11:14] = columns[STATE][:, 12:15] + 0.01  # The hand has it.
    found = offset_drives(columns, np.ones(count, bool), np.ones(count, bool), 0.05, np.random.default_rng(0))
    moved = (found[STATE] != columns[STATE]).any(axis=1)

    def from_hand(told: dict[str, np.ndarray], places: slice) -> np.ndarray:
        state, thing = told[STATE].astype(float), told[AROUND][:, :THING].astype(float)
        return np.asarray(Rotation.from_quat(state[:, 15:19]).inv().apply(thing[:, places] - state[:, 12:15]))

    for places in (slice(1, 4), slice(11, 14)):
        assert from_hand(found, places) == pytest.approx(from_hand(columns, places), abs=1e-4)
    assert (found[AROUND][moved, :THING] != columns[AROUND][moved, :THING]).any(axis=1).all()
    assert (found[AROUND][:, THING:] == columns[AROUND][:, THING:]).all(), "what nobody holds stays"


def test_it_is_learned_from_by_its_seed_and_what_is_to_be_done_stays(picked: EpisodeStore) -> None:
    plain, settings = small(), small(training={"beside_m": 0.05})
    seen, again, as_it_was = (read_demonstrations([picked.path], one) for one in (settings, settings, plain))
    assert (seen.numbers == again.numbers).all() and (seen.qpos == again.qpos).all()
    aside = (seen.qpos != as_it_was.qpos).any(axis=1)
    assert aside.any() and (seen.actions == as_it_was.actions).all()
    moments = np.flatnonzero(aside)
    chunks, before = seen.chunks(moments, 4)[0], as_it_was.chunks(moments, 4)[0]
    # From beside, one has to go by as much farther, whatever the heading.
    by_m = np.linalg.norm((seen.qpos - as_it_was.qpos)[moments, :2], axis=1)
    there = [np.hypot(*(rows[:, 0, :2]).T) for rows in (chunks, before)]
    assert (np.abs(there[0] - there[1]) <= by_m + 1e-4).all()


def test_who_does_the_hands_actions_or_sees_a_cloud_is_refused() -> None:
    for part in ({"acts": {"kind": "paper"}}, {"sees": {"kind": "cloud"}}):
        with pytest.raises(SettingsError, match="beside_m"):
            settings_of({**part, "training": {"beside_m": 0.05}}, "told")
