"""Demonstrations of a store as what training takes: for each moment what is seen, and the actions that follow."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.datasets.formats.clouds import POINTS
from executor.datasets.formats.export import open_set
from executor.datasets.formats.selection import WITHOUT_PICTURES, NothingToExport
from executor.datasets.formats.stream import CLOUD, EpisodeStream, Extra, FoldedEpisode, Repeats
from executor.datasets.store import NotADataset
from executor.datasets.units import DemoUnit, Origin
from executor.datasets.variation import UNVARIED, Variation
from executor.machine.files import content_key
from executor.policies.chunks import hand_poses, hands_from_here, targets_from_here
from executor.policies.seen.beside import beside
from executor.policies.seen.features import Numbers, own_numbers, state_numbers
from executor.policies.seen.mirror import mirrored
from executor.policies.seen.told import Told, demonstrations, robot_scale
from executor.policies.settings import PolicySettings, Sees
from executor.policies.steps import DRIVES, primitive_of, step_number, subtask_of
from executor.policies.ways import ways_of
from oag.model.primitives import Primitive
from oag.model.scenefile import FULL_SCALE, PAPER_SCALE


@dataclass(frozen=True, slots=True)
class EpisodeKind:
    """What episodes are drawn from, seeds left out.

    Attributes:
        origin: A family, or a sentence in a scene.
        variation: What else varies, without noise, which is in how a demonstration was made and not in what it is of.
        full_size: Whether the robot is of full size, as generation was told or as the scene itself has it.
    """

    origin: Origin
    variation: Variation = UNVARIED
    full_size: bool = False

    def to_json(self) -> dict[str, Any]:
        """Returns it as plain data."""
        return asdict(self)


@dataclass(frozen=True)
class Demonstrations:
    """All moments of all demonstrations, one episode after the other.

    Attributes:
        names: Of the episodes; their mirror images are rows, and have no names.
        key: Follows from what the episodes are.
        rate_hz: Moments a second.
        kinds: What the episodes are of, each once.
        seeds: Of the episodes, each once, in order.
        starts, ends: (M,) of each moment, where its episode begins and ends.
        lasts: (M,) up to where its chunk goes: where the primitive that is going on ends, if policies are told it,
            and else where its episode ends.
        qpos: (M, 12) joint positions.
        numbers: (M, F) what is seen of the state.
        clouds: (M, P, 4) float16 points and mask, or None.
        hands: (M, H, POSE_NUMBERS) where the hand is to be after each action of a chunk (`chunks.py`); None where that
            is not foretold.
        actions: (M, 12) joint targets or (M, 10) hand actions.
        phases: (M,) which of `steps` is going on.
        steps: The numbers of plans' steps that occur (`steps.py`), in order.
        takeovers: How many episodes go on from where a policy had come to.
        repeats: Episodes that are not among these, since their states and actions are those of another one, which each
            is named with.
        ways: (M,) which way the episode takes things in the subtask that is going on, 0 being the way of the most.
        begins: (M,) 1 where the first step of a subtask is going on, in which a way is chosen, else 0.
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
    ways: NDArray[np.int64]
    begins: NDArray[np.float32]
    repeats: Repeats = ()

    def __len__(self) -> int:
        return len(self.starts)

    def after_leaving(self, moments: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Returns rows in which another primitive has just begun, so many moments from each beginning on, and beside
        each the one that was left."""
        begun = np.flatnonzero((self.phases[1:] != self.phases[:-1]) & (self.starts[1:] == self.starts[:-1])) + 1
        rows = begun[:, None] + np.arange(moments)
        now = self.phases[np.minimum(rows, self.ends[begun, None] - 1)]
        within = (rows < self.ends[begun, None]) & (now == self.phases[begun, None])
        return rows[within], np.broadcast_to(self.phases[begun - 1, None], rows.shape)[within]

    def frames(self, moments: NDArray[np.int64], count: int) -> NDArray[np.int64]:
        """Returns (B, count) the moments up to each; before an episode begins, its first stands."""
        back = np.arange(1 - count, 1)
        return np.maximum(moments[:, None] + back, self.starts[moments, None])

    def chunks(self, moments: NDArray[np.int64], length: int) -> tuple[Numbers, NDArray[np.int64]]:
        """Returns (B, length, A) the actions from each moment on, as they are foretold, and (B, length) what goes on
        when each of them is done.

        Where a primitive ends, its last action stands: whoever is told what goes on does not begin with the next one
        before looking again. So do the last action and the last primitive of an episode.

        Args:
            moments: (B,) moments.
            length: How many actions.
        """
        later = moments[:, None] + np.arange(length)
        rows = np.minimum(later, self.lasts[moments, None] - 1)
        after = np.minimum(later + 1, self.ends[moments, None] - 1)
        actions = self.actions[rows]
        if actions.shape[-1] == self.qpos.shape[-1]:
            actions = targets_from_here(self.qpos[moments], actions)
        if self.hands is not None:
            actions = np.concatenate([actions, self.hands[moments, :length]], axis=-1)
        return actions, self.phases[after]


def read_demonstrations(paths: Sequence[Path], settings: PolicySettings, most: int | None = None) -> Demonstrations:
    """Returns the demonstrations of stores, or of what was exported of them, as a policy sees them.

    Args:
        paths: Their folders.
        settings: What the policy sees and does.
        most: How many to take of each, in the order of an export; by default all.

    Raises:
        NothingToExport: One has none, they are of different rates or robots, or an episode is in them twice.
        NotADataset: One of them cannot be read, or lacks the clouds that the policy sees.
    """
    include: tuple[Extra, ...] = ("point_cloud",) if settings.sees.kind == "cloud" else ()
    streams, scale = _of_one_robot(paths, include)
    found: list[Told] = []
    once = _Once([pair for stream in streams for pair in stream.found.repeats])
    rows: list[_Seen] = []
    # Those that an export keeps for validation are learned from too: policies are chosen by rollouts.
    for path, stream in zip(paths, streams, strict=True):
        for told_of, episode in islice(once.new(path, stream), most):
            found.append(told_of)
            if include and CLOUD not in episode.columns:
                raise NotADataset(f"{path} has no point clouds; train on the store, or export it with them")
            seen = _as_seen(episode, settings)
            rows += seen
    episodes = [episode for episode, *_ in rows]
    lengths = [episode.length for episode in episodes]
    ends = np.cumsum(lengths)
    going_on = [_going_on(episode) for episode in episodes]
    phases, episode_ends = np.concatenate(going_on), np.repeat(ends, lengths)
    steps = tuple(int(number) for number in np.unique(phases))
    column = "action.joint_target" if settings.acts.kind == "joint_target" else "action"
    lasts = _stretch_ends(phases, episode_ends) if settings.sees.phase else episode_ends
    return Demonstrations(
        names=tuple(one.name for one in found),
        key=_key(found),
        rate_hz=streams[0].found.rate_hz,
        kinds=_kinds(found, scale),
        seeds=_seeds(found),
        starts=np.repeat(ends - lengths, lengths),
        ends=episode_ends,
        lasts=lasts,
        qpos=np.concatenate([episode.columns["observation.state"][:, :12] for episode in episodes]),
        numbers=np.concatenate([numbers for _, numbers, _ in rows]),
        clouds=np.concatenate([cloud for *_, cloud in rows if cloud is not None]) if rows[0][2] is not None else None,
        hands=_hands(episodes, lasts, settings.acts.chunk, scale) if settings.acts.hand else None,
        actions=np.concatenate([episode.columns[column] for episode in episodes]),
        phases=np.searchsorted(steps, phases),
        steps=steps,
        takeovers=_takeovers(found),
        ways=ways_of(episodes, going_on),
        begins=np.concatenate([_begins(rows) for rows in going_on]),
        repeats=tuple(once.repeats),
    )


@dataclass
class _Once:
    """Which demonstrations were read, so that each counts once.

    Attributes:
        repeats: Names of those that are left out, each with the one whose states and actions it has.
    """

    repeats: list[tuple[str, str]]
    _holders: dict[str, Path] = field(default_factory=dict)
    _firsts: dict[str, str] = field(default_factory=dict)

    def new(self, path: Path, stream: EpisodeStream) -> Iterator[tuple[Told, FoldedEpisode]]:
        """Yield the demonstrations of a data set whose states and actions none before them has.

        Raises:
            NothingToExport: One is in a data set before this one already.
        """
        for told_of, episode in demonstrations(path, stream):
            if told_of.id in self._holders:
                raise NothingToExport(
                    f"{path} has the episode {told_of.name}, which {self._holders[told_of.id]} has already: it would "
                    "count twice; name each store once, or what was exported of it"
                )
            self._holders[told_of.id] = path
            called = f"{told_of.name} ({told_of.id[:8]})"
            first = self._firsts.setdefault(_recorded(episode), called)
            if first != called:
                self.repeats.append((called, first))
                continue
            yield told_of, episode


def _recorded(episode: FoldedEpisode) -> str:
    """Return what is equal where two episodes have the same states and actions, whatever they are kept in."""
    columns = ("observation.state", "observation.velocity", "observation.environment_state", "action.joint_target")
    return content_key(*(np.ascontiguousarray(episode.columns[name]).data.cast("B") for name in columns))


def _of_one_robot(paths: Sequence[Path], include: tuple[Extra, ...]) -> tuple[list[EpisodeStream], float]:
    """Returns what data sets hold, and the scale of their robot.

    Raises:
        NothingToExport: They are of different rates or robots.
        NotADataset: One of them cannot be read.
    """
    streams = [open_set(path, include, WITHOUT_PICTURES) for path in paths]
    if len({stream.found.rate_hz for stream in streams}) > 1:
        pairs = zip(paths, streams, strict=True)
        rates = ", ".join(f"{path}: {stream.found.rate_hz:g}" for path, stream in pairs)
        raise NothingToExport(f"the data sets have different numbers of samples a second ({rates}); a policy has one")
    sizes = [robot_scale(path, stream) for path, stream in zip(paths, streams, strict=True)]
    if len(set(sizes)) > 1:
        told = ", ".join(f"{path}: {size:g}" for path, size in zip(paths, sizes, strict=True))
        raise NothingToExport(
            f"the data sets are of robots of different scales ({told}); a policy has one robot, so train one on each"
        )
    return streams, sizes[0]


@dataclass(frozen=True, slots=True)
class LearnedFrom:
    """What a data set says to whoever asks what was learned from it.

    Attributes:
        rate_hz: Moments a second.
        kinds, seeds, key: As `Demonstrations` has them.
        demonstrations, takeovers: How many there are, and how many go on from where a policy had come to.
    """

    rate_hz: float
    kinds: tuple[EpisodeKind, ...]
    seeds: tuple[int, ...]
    key: str
    demonstrations: int
    takeovers: int


def learned_from(path: Path) -> LearnedFrom:
    """Returns what a store, or what was exported of one, is of; its motions are read one at a time, and none is kept.

    Raises:
        NothingToExport: It has no demonstrations.
        NotADataset: It cannot be read.
    """
    stream = open_set(path, (), WITHOUT_PICTURES)
    shown = [told for told, _ in demonstrations(path, stream)]
    return LearnedFrom(
        rate_hz=stream.found.rate_hz,
        kinds=_kinds(shown, robot_scale(path, stream)),
        seeds=_seeds(shown),
        key=_key(shown),
        demonstrations=len(shown),
        takeovers=_takeovers(shown),
    )


_Seen = tuple[FoldedEpisode, Numbers, NDArray[np.float16] | None]
"""An episode without its clouds, and of each of its moments what is seen in numbers and of the cloud."""


def _as_seen(episode: FoldedEpisode, settings: PolicySettings) -> list[_Seen]:
    """Returns an episode as a policy sees it, and behind it its mirror image where that is learned from."""
    found: list[_Seen] = []
    for seen in _images(episode) if settings.training.mirror else (episode,):
        if settings.training.beside_m:
            seen = _from_beside(seen, settings.training.beside_m, len(found))
        clouds = seen_clouds(seen, settings.sees.points) if settings.sees.kind == "cloud" else None
        # Whole clouds of all episodes at once would be too much.
        kept = {name: column for name, column in seen.columns.items() if name != CLOUD}
        found.append((replace(seen, columns=kept), seen_numbers(seen, settings.sees), clouds))
    return found


def _images(episode: FoldedEpisode) -> tuple[FoldedEpisode, ...]:
    """Returns an episode and, where the robot could do that, its mirror image."""
    columns = mirrored(episode.columns)
    return (episode,) if columns is None else (episode, replace(episode, columns=columns))


def _from_beside(episode: FoldedEpisode, off_m: float, image: int) -> FoldedEpisode:
    """Returns an episode with its drives seen from beside, drawn by its seed and by which of its images it is."""
    kinds = np.array([primitive_of(step) for step in _going_on(episode).tolist()])
    carries = kinds == Primitive.NAVIGATE_TO_SUPPORT
    rng = np.random.default_rng((DemoUnit.from_json(episode.about["unit"]).seed, image))
    return replace(episode, columns=beside(episode.columns, np.isin(kinds, DRIVES), carries, off_m, rng))


def _seeds(found: Iterable[Told]) -> tuple[int, ...]:
    return tuple(sorted({one.unit.seed for one in found}))


def _key(found: Iterable[Told]) -> str:
    return content_key(*(one.id for one in found))


def _takeovers(found: Iterable[Told]) -> int:
    return sum(one.takeover for one in found)


def seen_numbers(episode: FoldedEpisode, sees: Sees) -> Numbers:
    """Returns (N, F) what a policy is told in numbers at each moment of an episode."""
    agent = episode.columns["observation.state"]
    if not sees.places:
        return own_numbers(agent)
    return state_numbers(agent, episode.columns["observation.environment_state"], sees)


def seen_clouds(episode: FoldedEpisode, points: int) -> NDArray[np.float16]:
    """Returns (N, points, 4) the cloud at each moment of an episode that has clouds, chosen by its seed.

    Half precision is a millimetre at two metres, less than the noise that training adds.
    """
    chosen = chosen_points(points, DemoUnit.from_json(episode.about["unit"]).seed)
    return episode.columns[CLOUD][:, chosen].astype(np.float16)


def chosen_points(points: int, seed: int) -> NDArray[np.int64]:
    """Returns which points of a full cloud a policy sees: drawn by the seed, in order."""
    from_all = np.random.default_rng((seed, points)).permutation(POINTS)[:points]
    return np.sort(from_all)


def _going_on(episode: FoldedEpisode) -> NDArray[np.int64]:
    """Returns (N,) the steps' numbers, where none runs that of the next one, and after the last that of the last."""
    primitives = episode.columns["primitive_index"]
    running = np.flatnonzero(primitives)
    if not len(running):
        return primitives
    following = np.searchsorted(running, np.arange(len(primitives)))
    takeover = episode.about.get("takeover")
    # What a planner goes on with begins in the middle of the whole task.
    subtasks = episode.columns["subtask_index"] + (int(takeover["subtask"]) if takeover else 0)
    return step_number(subtasks, primitives)[running[np.minimum(following, len(running) - 1)]]


def scale_of(kinds: Sequence[EpisodeKind]) -> float:
    """Returns the robot's scale in episodes of some kinds, of a Panda's full size."""
    return FULL_SCALE if any(kind.full_size for kind in kinds) else PAPER_SCALE


def _hands(episodes: Sequence[FoldedEpisode], lasts: NDArray[np.int64], length: int, scale: float) -> Numbers:
    """Returns (M, length, POSE_NUMBERS) where joint targets want the hand, as seen from each moment.

    They are put together once: batches would take twice as long.
    """
    columns = ("observation.state", "action.joint_target")
    now, wanted = (
        hand_poses(np.concatenate([episode.columns[column][:, :12] for episode in episodes]), scale)
        for column in columns
    )
    first = np.arange(len(now))
    return np.stack(
        [hands_from_here(now, wanted[np.minimum(first + ahead, lasts - 1)]) for ahead in range(length)], axis=1
    )


def _begins(steps: NDArray[np.int64]) -> NDArray[np.float32]:
    """Returns (N,) 1 where the first step of a subtask is going on, and else 0."""
    found = np.zeros(len(steps), np.float32)
    _, firsts = np.unique(subtask_of(steps), return_index=True)
    for first in firsts:
        later = np.flatnonzero(steps[first:] != steps[first])
        found[first : first + later[0] if len(later) else None] = 1.0
    return found


def _stretch_ends(phases: NDArray[np.int64], ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Returns (M,) of each moment where the primitive that is going on ends, within its episode."""
    borders = np.append(np.flatnonzero((phases[1:] != phases[:-1]) | (ends[1:] != ends[:-1])) + 1, len(phases))
    return borders[np.searchsorted(borders, np.arange(len(phases)), side="right")]


def _kinds(found: Iterable[Told], scale: float) -> tuple[EpisodeKind, ...]:
    full_size = scale == FULL_SCALE
    units = (one.unit for one in found)
    return tuple(
        dict.fromkeys(EpisodeKind(unit.origin, replace(unit.variation, noise_m=0), full_size) for unit in units)
    )
