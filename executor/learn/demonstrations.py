"""Demonstrations as training data: observations per moment, the actions that follow, and grasp modes.

A grasp mode is a posture cluster: a hand reaches the same place with the elbow on either side and the wrist turned
either way. Nothing observable decides between them, so demonstrations are clustered, and a policy gets the mode or
chooses one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, ValidationError

from executor.data.episode import CLOUD, CORRECTION, DEMONSTRATION, FAILURE, Episode
from executor.data.formats.export import open_set
from executor.data.formats.selection import WITHOUT_PICTURES, NothingToExport
from executor.data.formats.table import EpisodeStream, Extra, Repeats
from executor.data.state_readers import AGENT_MORE, POINTS
from executor.data.store import NotADataset
from executor.data.units import UNVARIED, DemoUnit, Origin, Variation
from executor.learn.action_chunks import hand_poses, to_base_targets, to_hand_frame
from executor.learn.observations import (
    DRIVES,
    Numbers,
    mirror_columns,
    offset_drives,
    own_numbers,
    primitive_of,
    state_numbers,
    step_number,
    subtask_of,
)
from executor.learn.settings import PolicySettings, Sees
from executor.system.files import content_key
from oag import Scene
from oag.model.robots import FULL_SIZE, PAPER_ROBOT, Robot, chosen_robot, known_robot, robot_named, robot_of_record
from oag.model.symbols import ARTICULATIONS, Primitive


@dataclass(frozen=True, slots=True)
class EpisodeInfo:
    """Metadata of a demonstration.

    Attributes:
        id, name: Its id, in any format, and its human-readable name.
        takeover: Whether it continues from a state that a policy reached.
    """

    id: str
    name: str
    unit: DemoUnit
    takeover: bool


def demonstrations(path: Path, stream: EpisodeStream) -> Iterator[tuple[EpisodeInfo, Episode]]:
    """Yield the demonstrations of a data set with their metadata.

    Raises:
        NothingToExport: There are none.
        NotADataset: One has no valid metadata.
    """
    any_of_it = False
    for episode in stream.episodes():
        about = episode.about
        try:
            if (kind := about["kind"]) not in (DEMONSTRATION, CORRECTION, FAILURE):
                raise ValueError(f"kind is {kind!r}, expected {DEMONSTRATION!r}, {CORRECTION!r} or {FAILURE!r}")
            takeover = about.get("takeover")
            if takeover:
                int(takeover["subtask"])
            info = EpisodeInfo(str(about["id"]), str(about["name"]), DemoUnit.from_json(about["unit"]), bool(takeover))
        except (KeyError, TypeError, ValueError, AttributeError) as problem:
            raise _unreadable_metadata(path, f"of episode {episode.index}", problem) from None
        if kind == DEMONSTRATION:
            any_of_it = True
            yield info, episode
    if not any_of_it:
        raise NothingToExport(f"{path} has no demonstrations, and only these are learned from")


def robot_of_set(path: Path, stream: EpisodeStream) -> Robot:
    """Return the record of a data set's robot.

    Raises:
        NotADataset: It is missing or invalid.
    """
    try:
        return robot_of_record(stream.found.robot)
    except (KeyError, TypeError, ValueError) as problem:
        raise _unreadable_metadata(path, "of the robot", problem) from None


def _unreadable_metadata(path: Path, what: str, problem: Exception) -> NotADataset:
    if isinstance(problem, ValidationError):
        first = problem.errors()[0]
        words = f"{'.'.join(map(str, ('unit', *first['loc'])))}: {first['msg']}"
    else:
        words = f"it lacks {problem}" if isinstance(problem, KeyError) else str(problem)
    return NotADataset(
        f"{path} cannot be learned from: what it says {what} is not as it was written: {words}; "
        "export it again, or copy all of it"
    )


SAME_MODE_RAD = 1.0
"""Maximum distance within a mode, over all joints. Half a turn of the wrist or an elbow on the other side is 2 rad and
more; the places of things make 0.3 rad."""

MOST_GRASP_MODES = 8  # A mode of a few in a hundred demonstrations cannot be learned.


def grasp_modes_per_step(episodes: Sequence[Episode], going_on: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Return (M,) grasp-mode indices; modes are clustered per subtask."""
    subtasks = [subtask_of(steps) for steps in going_on]
    found = [np.zeros_like(rows) for rows in subtasks]
    for subtask in np.unique(np.concatenate(subtasks)):
        of_it = [rows == subtask for rows in subtasks]
        postures = [_postures_at_grasps(episode, rows) for episode, rows in zip(episodes, of_it, strict=True)]
        having = [number for number, rows in enumerate(of_it) if rows.any()]
        for number, mode in zip(having, cluster_grasp_modes([postures[number] for number in having]), strict=True):
            found[number][of_it[number]] = mode
    return np.concatenate(found)


def cluster_grasp_modes(postures: Sequence[NDArray]) -> NDArray[np.int64]:
    """Return (N,) the grasp mode of each demonstration; 0 is the most frequent.

    The mean of two modes reaches nowhere. A mode is a posture with others near it; those with the most neighbours come
    first. From `MOST_GRASP_MODES` on, all remaining ones are one mode.

    Args:
        postures: Per demonstration, (G, A) the arm at each of its grasps, or at its release [rad]. The last ones are
            compared with the last ones, since some demonstrations begin in the middle.
    """
    near = np.array([[_apart_rad(one, other) <= SAME_MODE_RAD for other in postures] for one in postures])
    found = np.full(len(postures), MOST_GRASP_MODES - 1)
    left = np.ones(len(postures), dtype=bool)
    for mode in range(MOST_GRASP_MODES - 1):
        if not left.any():
            break
        usual = near[np.where(left, near.astype(int) @ left, -1).argmax()] & left
        found[usual], left = mode, left & ~usual
    return found


def _apart_rad(one: NDArray, other: NDArray) -> float:
    """Return the distance of two demonstrations' postures at their most different grasp, summed over joints."""
    count = min(len(one), len(other))
    return float(np.abs(one[len(one) - count :] - other[len(other) - count :]).sum(axis=1).max(initial=0.0))


def _postures_at_grasps(episode: Episode, rows: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return (G, A) the arm, and the lift, at the begin of each of an episode's grasps within some rows.

    Without grasps, as for an item that is only placed, it is the arm at its release. An episode that continues with the
    handle already in the hand has none.
    """
    primitives = episode.columns["primitive_index"]
    grasping = (primitives == Primitive.GRASP) & rows
    if not grasping.any() and not (np.isin(primitives, list(ARTICULATIONS)) & rows).any():
        grasping = (primitives == Primitive.UNGRASP) & rows
    begun = np.flatnonzero(grasping & ~np.append(False, grasping[:-1]))
    return episode.columns["observation.state"][begun, 3:-10]


@dataclass(frozen=True, slots=True)
class EpisodeKind:
    """Distribution of episodes, without seeds.

    Attributes:
        origin: A family, or a sentence in a scene.
        variation: Further variation, without noise, which belongs to a demonstration's making and not to its task.
        full_size: Whether the robot is the Panda of full size, from the request or from the scene itself.
        robot: Name of another robot than that or the paper's.
    """

    origin: Origin
    variation: Variation = UNVARIED
    full_size: bool = False
    robot: Annotated[str, AfterValidator(known_robot)] = ""

    @classmethod
    def of(cls, origin: Origin, robot: Robot, variation: Variation = UNVARIED) -> EpisodeKind:
        """Return the kind of a robot's episodes."""
        return cls(origin, variation, robot is FULL_SIZE, "" if robot in (PAPER_ROBOT, FULL_SIZE) else robot.name)

    @property
    def robot_name(self) -> str:
        """Name of the robot; empty for the scene's own, or the paper's."""
        return chosen_robot(self.robot, full_size=self.full_size)

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data, without a robot's name where earlier programs wrote none."""
        data = asdict(self)
        if not self.robot:
            del data["robot"]
        return data


@dataclass(frozen=True)
class Demonstrations:
    """All moments of all demonstrations, one episode after the other.

    Attributes:
        names: Names of the episodes; their mirror images are rows without names.
        rate_hz: Moments a second.
        kinds: Distributions of the episodes, each once.
        seeds: Seeds of the episodes, each once, in order.
        starts, ends: (M,) begin and end of each moment's episode.
        lasts: (M,) end of each moment's chunk: of the running primitive, if policies observe it, and otherwise of the
            episode.
        qpos: (M, J) joint positions.
        numbers: (M, F) state features.
        clouds: (M, P, 4) float16 points and mask, or None.
        hands: (M, H, POSE_NUMBERS) hand pose after each action of a chunk (`action_chunks.py`); None where it is not
            predicted.
        actions: (M, J) joint targets or (M, H) hand actions.
        phases: (M,) index of the running step in `steps`.
        steps: The step numbers that occur (`observations.py`), in order.
        takeovers: Number of episodes that continue from a state that a policy reached.
        repeats: Omitted episodes with the states and actions of another one, each with the name of that.
        grasp_modes: (M,) grasp mode of the running subtask; 0 is the most frequent.
        begins: (M,) 1 in the first step of a subtask, where a mode is chosen, else 0.
    """

    names: tuple[str, ...]
    key: str
    rate_hz: float
    kinds: tuple[EpisodeKind, ...]
    seeds: tuple[int, ...]
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    lasts: NDArray[np.int64]
    qpos: NDArray[np.float32]
    numbers: Numbers
    clouds: NDArray[np.float16] | None
    hands: NDArray[np.float32] | None
    actions: NDArray[np.float32]
    phases: NDArray[np.int64]
    steps: tuple[int, ...]
    takeovers: int
    grasp_modes: NDArray[np.int64]
    begins: NDArray[np.float32]
    repeats: Repeats = ()

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def robot(self) -> Robot:
        """The record of its robot."""
        return robot_of_kinds(self.kinds)

    def after_leaving(self, moments: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the first `moments` rows of each step after a change, and the step that was left for each."""
        begun = np.flatnonzero((self.phases[1:] != self.phases[:-1]) & (self.starts[1:] == self.starts[:-1])) + 1
        rows = begun[:, None] + np.arange(moments)
        now = self.phases[np.minimum(rows, self.ends[begun, None] - 1)]
        within = (rows < self.ends[begun, None]) & (now == self.phases[begun, None])
        return rows[within], np.broadcast_to(self.phases[begun - 1, None], rows.shape)[within]

    def frames(self, moments: NDArray[np.int64], count: int) -> NDArray[np.int64]:
        """Return (B, count) the moments up to each; before an episode begins, its first is repeated."""
        back = np.arange(1 - count, 1)
        return np.maximum(moments[:, None] + back, self.starts[moments, None])

    def chunks(self, moments: NDArray[np.int64], length: int) -> tuple[Numbers, NDArray[np.int64]]:
        """Return (B, length, A) action chunks as predicted, and (B, length) the running step after each action.

        At the end of a primitive its last action is repeated: a policy that observes the step observes again before the
        next one. So are the last action and the last primitive of an episode.
        """
        later = moments[:, None] + np.arange(length)
        rows = np.minimum(later, self.lasts[moments, None] - 1)
        after = np.minimum(later + 1, self.ends[moments, None] - 1)
        actions = self.actions[rows]
        if actions.shape[-1] == self.qpos.shape[-1]:
            actions = to_base_targets(self.robot, self.qpos[moments], actions)
        if self.hands is not None:
            actions = np.concatenate([actions, self.hands[moments, :length]], axis=-1)
        return actions, self.phases[after]


def read_demonstrations(paths: Sequence[Path], settings: PolicySettings, most: int | None = None) -> Demonstrations:
    """Read the demonstrations of stores or exports, as a policy observes them.

    Args:
        settings: The policy's observations and actions.
        most: Maximum number from each, in the order of an export; by default all.

    Raises:
        NothingToExport: One has none, they differ in rate or robot, or an episode occurs twice.
        NotADataset: One of them is unreadable, or lacks the clouds that the policy observes.
    """
    include: tuple[Extra, ...] = ("point_cloud",) if settings.sees.kind == "cloud" else ()
    streams, robot = _of_one_robot(paths, include)
    found: list[EpisodeInfo] = []
    once = _Deduplicator([pair for stream in streams for pair in stream.found.repeats])
    rows: list[_ObservedEpisode] = []
    # An export's validation episodes are used, too: policies are chosen by rollouts.
    for path, stream in zip(paths, streams, strict=True):
        for info, episode in islice(once.new(path, stream), most):
            found.append(info)
            if include and CLOUD not in episode.columns:
                raise NotADataset(f"{path} has no point clouds; train on the store, or export it with them")
            observed = _observe_episode(episode, settings)
            rows += observed
    episodes = [episode for episode, *_ in rows]
    lengths = [episode.length for episode in episodes]
    ends = np.cumsum(lengths)
    steps_by_episode = [_steps_in_progress(episode) for episode in episodes]
    phases, episode_ends = np.concatenate(steps_by_episode), np.repeat(ends, lengths)
    steps = tuple(int(number) for number in np.unique(phases))
    column = "action.joint_target" if settings.acts.kind == "joint_target" else "action"
    lasts = _stretch_ends(phases, episode_ends) if settings.sees.phase else episode_ends
    return Demonstrations(
        names=tuple(one.name for one in found),
        key=_key(found),
        rate_hz=streams[0].found.rate_hz,
        kinds=_kinds(found, robot),
        seeds=_seeds(found),
        starts=np.repeat(ends - lengths, lengths),
        ends=episode_ends,
        lasts=lasts,
        qpos=np.concatenate([episode.columns["observation.state"][:, :-AGENT_MORE] for episode in episodes]),
        numbers=np.concatenate([numbers for _, numbers, _ in rows]),
        clouds=np.concatenate([cloud for *_, cloud in rows if cloud is not None]) if rows[0][2] is not None else None,
        hands=_hands(episodes, lasts, settings.acts.chunk, robot) if settings.acts.hand else None,
        actions=np.concatenate([episode.columns[column] for episode in episodes]),
        phases=np.searchsorted(steps, phases),
        steps=steps,
        takeovers=_takeovers(found),
        grasp_modes=grasp_modes_per_step(episodes, steps_by_episode),
        begins=np.concatenate([_begins(rows) for rows in steps_by_episode]),
        repeats=tuple(once.repeats),
    )


@dataclass
class _Deduplicator:
    """Filter of duplicate demonstrations.

    Attributes:
        repeats: Names of omitted ones, each with the one whose states and actions it has.
    """

    repeats: list[tuple[str, str]]
    _holders: dict[str, Path] = field(default_factory=dict)
    _firsts: dict[str, str] = field(default_factory=dict)

    def new(self, path: Path, stream: EpisodeStream) -> Iterator[tuple[EpisodeInfo, Episode]]:
        """Yield the demonstrations of a data set with new states and actions.

        Raises:
            NothingToExport: One is already in an earlier data set.
        """
        for info, episode in demonstrations(path, stream):
            if info.id in self._holders:
                raise NothingToExport(
                    f"{path} has the episode {info.name}, which {self._holders[info.id]} has already: it would "
                    "count twice; name each store once, or what was exported of it"
                )
            self._holders[info.id] = path
            called = f"{info.name} ({info.id[:8]})"
            first = self._firsts.setdefault(_recorded(episode), called)
            if first != called:
                self.repeats.append((called, first))
                continue
            yield info, episode


def _recorded(episode: Episode) -> str:
    """Return a key of an episode's states and actions, in any format."""
    columns = ("observation.state", "observation.velocity", "observation.environment_state", "action.joint_target")
    return content_key(*(np.ascontiguousarray(episode.columns[name]).data.cast("B") for name in columns))


def _of_one_robot(paths: Sequence[Path], include: tuple[Extra, ...]) -> tuple[list[EpisodeStream], Robot]:
    """Open data sets, and return the record of their robot.

    Raises:
        NothingToExport: They differ in rate or robot.
    """
    streams = [open_set(path, include, WITHOUT_PICTURES) for path in paths]
    if len({stream.found.rate_hz for stream in streams}) > 1:
        pairs = zip(paths, streams, strict=True)
        rates = ", ".join(f"{path}: {stream.found.rate_hz:g}" for path, stream in pairs)
        raise NothingToExport(f"the data sets have different numbers of samples a second ({rates}); a policy has one")
    robots = [robot_of_set(path, stream) for path, stream in zip(paths, streams, strict=True)]
    if len({robot.name for robot in robots}) > 1:
        names = ", ".join(f"{path}: {robot.name}" for path, robot in zip(paths, robots, strict=True))
        raise NothingToExport(
            f"the data sets are of different robots ({names}); a policy has one robot, so train one on each"
        )
    return streams, robots[0]


@dataclass(frozen=True, slots=True)
class LearnedFrom:
    """Summary of a data set that a policy was trained on.

    Attributes:
        rate_hz: Moments a second.
        kinds, seeds, key: As in `Demonstrations`.
        demonstrations, takeovers: Number of demonstrations, and of those that continue from a state that a policy
            reached.
        home: Whether all pictures show a home.
    """

    rate_hz: float
    kinds: tuple[EpisodeKind, ...]
    seeds: tuple[int, ...]
    key: str
    demonstrations: int
    takeovers: int
    home: bool


def learned_from(path: Path) -> LearnedFrom:
    """Summarise a store or an export; one motion at a time is in memory.

    Raises:
        NothingToExport: It has no demonstrations.
    """
    stream = open_set(path, (), WITHOUT_PICTURES)
    shown = [info for info, _ in demonstrations(path, stream)]
    return LearnedFrom(
        rate_hz=stream.found.rate_hz,
        kinds=_kinds(shown, robot_of_set(path, stream)),
        seeds=_seeds(shown),
        key=_key(shown),
        demonstrations=len(shown),
        takeovers=_takeovers(shown),
        home=all(info.unit.recording.home for info in shown),
    )


_ObservedEpisode = tuple[Episode, Numbers, NDArray[np.float16] | None]
"""An episode without its clouds, and the observed numbers and cloud points of each of its moments."""


def _observe_episode(episode: Episode, settings: PolicySettings) -> list[_ObservedEpisode]:
    """Return an episode as a policy observes it, and its mirror image where training uses that."""
    found: list[_ObservedEpisode] = []
    for observed in _images(episode) if settings.training.mirror else (episode,):
        if settings.training.drive_offset_m:
            observed = _with_offset_drives(observed, settings.training.drive_offset_m, len(found))
        clouds = observed_clouds(observed, settings.sees.points) if settings.sees.kind == "cloud" else None
        # All episodes' whole clouds would take too much memory.
        kept = {name: column for name, column in observed.columns.items() if name != CLOUD}
        found.append((replace(observed, columns=kept), observed_numbers(observed, settings.sees), clouds))
    return found


def _images(episode: Episode) -> tuple[Episode, ...]:
    """Return an episode and, where the robot could do that, its mirror image."""
    columns = mirror_columns(Scene.from_json(episode.about["scene"]).robot.model, episode.columns)
    return (episode,) if columns is None else (episode, replace(episode, columns=columns))


def _with_offset_drives(episode: Episode, off_m: float, image: int) -> Episode:
    """Offset an episode's drives, drawn by its seed and the number of its image."""
    kinds = np.array([primitive_of(step) for step in _steps_in_progress(episode).tolist()])
    carries = kinds == Primitive.NAVIGATE_TO_SUPPORT
    rng = np.random.default_rng((DemoUnit.from_json(episode.about["unit"]).seed, image))
    return replace(episode, columns=offset_drives(episode.columns, np.isin(kinds, DRIVES), carries, off_m, rng))


def _seeds(found: Iterable[EpisodeInfo]) -> tuple[int, ...]:
    return tuple(sorted({one.unit.seed for one in found}))


def _key(found: Iterable[EpisodeInfo]) -> str:
    return content_key(*(one.id for one in found))


def _takeovers(found: Iterable[EpisodeInfo]) -> int:
    return sum(one.takeover for one in found)


def observed_numbers(episode: Episode, sees: Sees) -> Numbers:
    """Return (N, F) the numbers that a policy observes at each moment of an episode."""
    agent = episode.columns["observation.state"]
    if not sees.places:
        return own_numbers(agent)
    return state_numbers(agent, episode.columns["observation.environment_state"], sees)


def observed_clouds(episode: Episode, points: int) -> NDArray[np.float16]:
    """Return (N, points, 4) the cloud at each moment of an episode, with points chosen by its seed.

    Half precision is a millimetre at two metres, less than the noise that training adds.
    """
    chosen = draw_point_indices(points, DemoUnit.from_json(episode.about["unit"]).seed)
    return episode.columns[CLOUD][:, chosen].astype(np.float16)


def draw_point_indices(points: int, seed: int) -> NDArray[np.int64]:
    """Draw the indices of a full cloud's points that a policy observes, by the seed, in order."""
    from_all = np.random.default_rng((seed, points)).permutation(POINTS)[:points]
    return np.sort(from_all)


def _steps_in_progress(episode: Episode) -> NDArray[np.int64]:
    """Return (N,) step numbers; between steps that of the next one, and after the last that of the last."""
    primitives = episode.columns["primitive_index"]
    running = np.flatnonzero(primitives)
    if not len(running):
        return primitives
    following = np.searchsorted(running, np.arange(len(primitives)))
    takeover = episode.about.get("takeover")
    # After a takeover the plan begins in the middle of the whole task.
    subtasks = episode.columns["subtask_index"] + (int(takeover["subtask"]) if takeover else 0)
    return step_number(subtasks, primitives)[running[np.minimum(following, len(running) - 1)]]


def robot_of_kinds(kinds: Sequence[EpisodeKind]) -> Robot:
    """Return the record of the robot in episodes of some kinds."""
    return robot_named(next((kind.robot_name for kind in kinds if kind.robot_name), PAPER_ROBOT.name))


def _hands(episodes: Sequence[Episode], lasts: NDArray[np.int64], length: int, robot: Robot) -> Numbers:
    """Return (M, length, POSE_NUMBERS) hand poses of the joint targets, relative to each moment's hand.

    They are computed once: per batch it would take twice as long.
    """
    columns, joints = ("observation.state", "action.joint_target"), len(robot.joint_names)
    now, wanted = (
        hand_poses(np.concatenate([episode.columns[column][:, :joints] for episode in episodes]), robot)
        for column in columns
    )
    first = np.arange(len(now))
    return np.stack(
        [to_hand_frame(now, wanted[np.minimum(first + ahead, lasts - 1)]) for ahead in range(length)], axis=1
    )


def _begins(steps: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return (N,) 1 in the first step of a subtask, else 0."""
    found = np.zeros(len(steps), np.float32)
    _, firsts = np.unique(subtask_of(steps), return_index=True)
    for first in firsts:
        later = np.flatnonzero(steps[first:] != steps[first])
        found[first : first + later[0] if len(later) else None] = 1.0
    return found


def _stretch_ends(phases: NDArray[np.int64], ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (M,) the end of the running primitive at each moment, within its episode."""
    borders = np.append(np.flatnonzero((phases[1:] != phases[:-1]) | (ends[1:] != ends[:-1])) + 1, len(phases))
    return borders[np.searchsorted(borders, np.arange(len(phases)), side="right")]


def _kinds(found: Iterable[EpisodeInfo], robot: Robot) -> tuple[EpisodeKind, ...]:
    units = (one.unit for one in found)
    return tuple(
        dict.fromkeys(EpisodeKind.of(unit.origin, robot, replace(unit.variation, noise_m=0)) for unit in units)
    )
