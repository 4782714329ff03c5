"""Spoil recorded episodes: each spoiler changes one thing of a record and leaves all else as an honest one has it.

Written apart from the audit: nothing of it is imported. A state is changed in a world of its own, and the columns are
those of the changed state.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from executor.data import samples
from executor.data.store import META, SAMPLES, UNITS, EpisodeStore, StoredEpisode
from executor.sim.world import World

LAST = 15
"""Rows at the end that a spoiler of states changes."""


@dataclass
class Record:
    """What a spoiler changes.

    Attributes:
        meta: Content of `unit.json`.
        arrays: The samples.
        episode: The clean one.
        rng: For its choices.
    """

    meta: dict[str, Any]
    arrays: dict[str, Any]
    episode: StoredEpisode
    rng: np.random.Generator

    @property
    def goal_items(self) -> list[str]:
        """Movable things that the goal names, or all where it names none."""
        named = [name for name in self.meta["object_ids"] if name in self.meta["task"]["goal"]]
        return named or list(self.meta["object_ids"])

    @property
    def goal_furniture(self) -> list[str]:
        """Things with joints that the goal says to be open or shut."""
        return [name for name in self.meta["joint_ids"] if f"(open {name})" in self.meta["task"]["goal"]]

    def pick(self, names: Iterable[str]) -> str:
        """Choose one."""
        return str(self.rng.choice(sorted(names)))

    def change_states(self, rows: Iterable[int], change: Callable[[World], None]) -> None:
        """Change the states of some rows, and the columns with them."""
        with World(self.episode.scene) as world:
            for row in rows:
                world.unpack(self.arrays["packed_states"][row].tobytes())
                change(world)
                self.arrays["packed_states"][row] = np.frombuffer(world.pack(), "<f4")
                self.arrays["object_poses"][row] = world.root_poses(self.meta["object_ids"])
                self.arrays["joint_positions"][row] = [
                    world.joint_position(name, joint.name)
                    for name in self.meta["joint_ids"]
                    for joint in world.assets[name].joints
                ]

    @property
    def last(self) -> range:
        """The last rows."""
        count = len(self.arrays["time_s"])
        return range(count - LAST, count)


Spoiler = Callable[[Record], None]


def _moved(name: str, offset_m: tuple[float, float, float]) -> Callable[[World], None]:
    def change(world: World) -> None:
        T = world.T_world_link(name).copy()
        T[:3, 3] += offset_m
        world.set_object_pose(name, T)

    return change


def _turned(name: str, degrees: float) -> Callable[[World], None]:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))

    def change(world: World) -> None:
        T = world.T_world_link(name).copy()
        T[:3, :3] = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ T[:3, :3]
        world.set_object_pose(name, T)

    return change


def state_aside(record: Record) -> None:
    """At the end a thing is a hand's breadth farther."""
    record.change_states(record.last, _moved(record.pick(record.goal_items), (0.0, 0.25, 0.0)))


def state_hovers(record: Record) -> None:
    """At the end a thing hangs in the air."""
    record.change_states(record.last, _moved(record.pick(record.goal_items), (0.0, 0.0, 0.25)))


def state_joint(record: Record) -> None:
    """At the end a door is as it was at first, or else a thing is aside."""
    if not record.goal_furniture:
        state_aside(record)
        return
    name = record.pick(record.goal_furniture)
    wanted_open = f"(not (open {name}))" not in record.meta["task"]["goal"]

    def change(world: World) -> None:
        joints = world.assets[name].joints
        world.set_joint_positions(name, [joint.position(0.0 if wanted_open else 0.5) for joint in joints])

    record.change_states(record.last, change)


def state_cut(record: Record) -> None:
    """The recording ends before its purpose."""
    count = int(0.4 * len(record.arrays["time_s"]))
    for name in list(record.arrays):
        if not name.startswith("command"):
            record.arrays[name] = record.arrays[name][:count]
    record.meta["samples"] = count


def state_jump(record: Record) -> None:
    """In the middle a thing is somewhere else for a moment."""
    row = len(record.arrays["time_s"]) // 2
    record.change_states([row], _moved(record.pick(record.meta["object_ids"]), (0.3, 0.0, 0.1)))


def state_columns(record: Record) -> None:
    """Columns are not those of the states."""
    record.arrays["object_poses"][len(record.arrays["time_s"]) // 3 :, 0, :3] += 0.01


def column_no_number(record: Record) -> None:
    """A place is no number."""
    record.arrays["object_poses"][len(record.arrays["time_s"]) // 3, 0, 1] = np.nan


def column_turned(record: Record) -> None:
    """A thing's heading is another than that of its state."""
    half = np.radians(5.0) / 2.0
    w, x, y, z = record.arrays["object_poses"][:, 0, 3:].T
    c, s = np.cos(half), np.sin(half)
    turned = np.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], axis=1)
    record.arrays["object_poses"][:, 0, 3:] = turned


def column_joint(record: Record) -> None:
    """A door is wider open than in its state."""
    record.arrays["joint_positions"][-1, 0] += 0.02


def column_hand(record: Record) -> None:
    """The hand is a centimeter higher than the robot has it."""
    record.arrays["eef_pose"][:, 2] += 0.01


def column_speed(record: Record) -> None:
    """The robot is faster than in its state."""
    record.arrays["robot_qvel"][1:, 0] += 0.05


def column_left_out(record: Record) -> None:
    """A thing of the scene has no column."""
    del record.meta["object_ids"][-1]
    record.arrays["object_poses"] = record.arrays["object_poses"][:, :-1]


def _set_goal(record: Record, goal: str) -> None:
    assert goal != record.meta["task"]["goal"]
    record.meta["task"]["goal"] = goal


def goal_negated(record: Record) -> None:
    """The goal is the contrary."""
    _set_goal(record, f"(not {record.meta['task']['goal']})")


def goal_more(record: Record) -> None:
    """The goal wants a drawer or door as it is anyway, which nobody asked for."""
    others = [name for name in record.meta["joint_ids"] if name not in record.meta["task"]["goal"]]
    if others:
        _set_goal(record, f"(and {record.meta['task']['goal']} (not (open {record.pick(others)})))")
    else:
        goal_negated(record)


def goal_elsewhere(record: Record) -> None:
    """The goal is about another thing."""
    goal, items = record.meta["task"]["goal"], record.meta["object_ids"]
    for group in (items, record.meta["joint_ids"]):
        named = [name for name in group if name in goal]
        others = [name for name in group if name not in goal]
        if named and others:
            _set_goal(record, goal.replace(named[0], record.pick(others)))
            return
    goal_negated(record)


def goal_weaker(record: Record) -> None:
    """The goal is satisfied by anything."""
    goal = record.meta["task"]["goal"]
    _set_goal(record, f"(or {goal} (not {goal}))")


def _say(record: Record, query: str) -> None:
    assert query != record.meta["query"]
    record.meta["query"] = query


def _noun(record: Record, name: str) -> str:
    return str(record.meta["scene"]["objects"][name]["category"]).replace("_", " ")


def sentence_verb(record: Record) -> None:
    """The sentence asks for the contrary: something is to be opened that was closed, or put down that was taken."""
    query = record.meta["query"].lower()
    for word, other in (("open", "close"), ("close", "open"), ("shut", "open"), ("pick up", "open"), ("put", "open")):
        if word in query:
            _say(record, query.replace(word, other, 1))
            return
    _say(record, f"do not {query}")


def sentence_thing(record: Record) -> None:
    """The sentence is about a thing that the goal does not name."""
    goal, things = record.meta["task"]["goal"], record.meta["scene"]["objects"]
    others = [name for name in things if name not in goal and name != "floor"]
    name = record.pick(others) if others else ""
    _say(record, f"pick up the {_noun(record, name)}" if name in record.meta["object_ids"] else "close the window")


def sentence_more(record: Record) -> None:
    """The sentence asks for more than was done."""
    items = [name for name in record.meta["object_ids"] if name not in record.meta["task"]["goal"]]
    more = f"pick up the {_noun(record, record.pick(items))}" if items else "sing a song"
    _say(record, f"{record.meta['query']} and then {more}")


def sentence_empty(record: Record) -> None:
    """There is no sentence."""
    _say(record, "")


def sentence_noise(record: Record) -> None:
    """The sentence is none."""
    _say(record, " ".join(reversed(record.meta["query"].split())))


def asset_size(record: Record) -> None:
    """A thing is larger than it was."""
    thing = record.meta["scene"]["objects"][record.pick(record.meta["object_ids"])]
    thing["bbox_extent"] = [1.02 * side for side in thing["bbox_extent"]]


def asset_hash(record: Record) -> None:
    """A thing's model was another."""
    name = record.pick(record.meta["assets"])
    digits = record.meta["assets"][name]
    record.meta["assets"][name] = ("1" if digits[0] != "1" else "2") + digits[1:]


def asset_lost(record: Record) -> None:
    """A thing has no hash."""
    del record.meta["assets"][record.pick(record.meta["assets"])]


def asset_furniture(record: Record) -> None:
    """A piece of furniture is wider than it was."""
    things = record.meta["scene"]["objects"]
    names = [name for name in things if name not in record.meta["object_ids"] and name != "floor"]
    thing = things[record.pick(names)]
    thing["bbox_extent"] = [*thing["bbox_extent"][:2], 0.99 * thing["bbox_extent"][2]]


FIRST = range(3)


def start_floats(record: Record) -> None:
    """A thing begins in the air."""
    record.change_states(FIRST, _moved(record.pick(record.meta["object_ids"]), (0.0, 0.0, 0.12)))


def start_fallen(record: Record) -> None:
    """A thing begins on its side, at the height that it lies at; a ball, which has none, begins elsewhere."""
    name = record.pick(record.meta["object_ids"])
    extent = record.meta["scene"]["objects"][name]["bbox_extent"]
    if max(extent) / min(extent) < 1.2:
        record.change_states(FIRST, _moved(name, (0.0, 0.0, 0.08)))
        return
    record.change_states(FIRST, _turned(name, 85.0))


def start_sunk(record: Record) -> None:
    """A thing begins in its support."""
    record.change_states(FIRST, _moved(record.pick(record.meta["object_ids"]), (0.0, 0.0, -0.025)))


def start_elsewhere(record: Record) -> None:
    """A thing begins where the scene does not have it."""
    thing = record.meta["scene"]["objects"][record.pick(record.meta["object_ids"])]
    x_m, y_m, z_m = thing["position"]
    thing["position"] = [x_m, y_m + 0.2, z_m]


def start_done(record: Record) -> None:
    """The goal holds at the beginning."""
    for name in ("packed_states", "object_poses", "joint_positions", "robot_qpos", "robot_qvel", "eef_pose"):
        record.arrays[name][:3] = record.arrays[name][-1]


SPOILERS: dict[str, tuple[Spoiler, ...]] = {
    "state": (
        *(state_aside, state_hovers, state_joint, state_cut, state_jump, state_columns),
        *(column_no_number, column_turned, column_joint, column_hand, column_speed, column_left_out),
    ),
    "goal": (goal_negated, goal_more, goal_elsewhere, goal_weaker),
    "sentence": (sentence_verb, sentence_thing, sentence_more, sentence_empty, sentence_noise),
    "asset": (asset_size, asset_hash, asset_lost, asset_furniture),
    "start": (start_floats, start_fallen, start_sunk, start_elsewhere, start_done),
}
"""What is spoiled -> the spoilers of it."""


def spoiled(episode: StoredEpisode, spoiler: Spoiler, seed: int) -> Record:
    """Return what a spoiler makes of an episode."""
    arrays = {name: values.copy() for name, values in episode.arrays.items()}
    record = Record(deepcopy(dict(episode.meta)), arrays, episode, np.random.default_rng(seed))
    spoiler(record)
    return record


def spoil(episode: StoredEpisode, spoiler: Spoiler, seed: int, store: Path) -> StoredEpisode:
    """Write a spoiled copy of an episode into a store of its own, and return it."""
    record = spoiled(episode, spoiler, seed)
    folder = store / UNITS / episode.name
    shutil.copytree(episode.path, folder)
    (folder / META).write_text(json.dumps(record.meta), encoding="utf-8")
    (folder / SAMPLES).write_bytes(samples.packed(record.arrays))
    return EpisodeStore(store).episode(episode.name)
