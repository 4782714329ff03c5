"""Audit the episodes of a store, one verdict each, and keep it with the episode.

A verdict is a file of the unit's folder, `audit.json`. It counts as long as `unit.json` and the samples are the same.
Episodes without motion are left out, unless they are recorded as successes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from typing import Any, Literal

from executor.assets.parameters import AssetError
from executor.audit import checks
from executor.audit.checks import Finding, Recorded
from executor.audit.replay import replay
from executor.data.store import AUDIT, EpisodeStore, NotADataset, StoredEpisode
from executor.data.units import DemoUnit
from executor.data.work import physics_of
from executor.sim.world import World
from executor.system.files import write_json
from executor.system.progress import OnProgress, ignore_progress
from executor.system.workers import WorkerPool

SCHEMA = "scene2demo-audit/1"
WORKER = "executor.audit.worker"
"""Module of the worker process."""


@dataclass(frozen=True, slots=True)
class EpisodeVerdict:
    """What the audit of an episode found.

    Attributes:
        episode: Name of its folder.
        verdict: "sound", "flawed" where a check found something, "undecided" where only the goal could not be decided.
        replayed: Whether the commands were repeated, too.
        findings: What was found.
    """

    episode: str
    verdict: Literal["sound", "flawed", "undecided"]
    replayed: bool
    findings: tuple[Finding, ...] = ()

    @classmethod
    def of(cls, episode: str, findings: Iterable[Finding], *, replayed: bool) -> EpisodeVerdict:
        """Return the verdict that findings amount to."""
        found = tuple(findings)
        kinds = {finding.kind for finding in found}
        verdict: Literal["sound", "flawed", "undecided"] = "flawed" if kinds - {"undecided"} else "sound"
        return cls(episode, "undecided" if kinds == {"undecided"} else verdict, replayed, found)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of its findings, each once."""
        return tuple(dict.fromkeys(finding.kind for finding in self.findings))

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {**asdict(self), "kinds": list(self.kinds)}

    @classmethod
    def from_json(cls, value: Any) -> EpisodeVerdict:
        """Read what `to_json` returned."""
        findings = tuple(Finding(found["kind"], found["text"]) for found in value["findings"])
        return cls(value["episode"], value["verdict"], bool(value["replayed"]), findings)


def audit_episode(episode: StoredEpisode, *, with_replay: bool = True) -> EpisodeVerdict:
    """Return the verdict on an episode.

    Args:
        episode: An episode with samples, or one that is recorded as a success.
        with_replay: Whether its commands are repeated, which takes most of the time.
    """
    findings: list[Finding] = []
    try:
        for finding in _findings(episode, with_replay=with_replay):
            findings.append(finding)
    except AssetError as problem:
        findings.append(Finding("asset", f"an asset of its scene cannot be built: {problem}"))
    except Exception as problem:  # Whatever the engine or a library makes of a forged record: the others are audited.
        findings.append(Finding("unreadable", f"{type(problem).__name__}: {problem}"))
    return EpisodeVerdict.of(episode.name, findings, replayed=with_replay)


def _findings(episode: StoredEpisode, *, with_replay: bool) -> Iterator[Finding]:
    if not episode.has_samples:
        yield Finding("unreadable", "it is recorded as succeeded, and its motion is missing")
        return
    unit = DemoUnit.from_json(episode.meta["unit"])
    midway = episode.meta.get("takeover") is not None
    recorded = Recorded(unit, episode.scene, episode.whole_task, episode.meta, episode.arrays, midway)
    yield from checks.record(recorded, str(episode.meta["version"]))
    yield from checks.sentence(recorded)
    yield from checks.plan(recorded, episode.task)
    yield from checks.assets(recorded)
    with World(episode.scene, physics=physics_of(unit)) as world:
        scene_start = world.pack()
        if len(recorded.state(0)) != len(scene_start):
            yield Finding("states", "its states are of a scene with other objects")
            return
        yield from checks.states(recorded, world)
        yield from checks.start(recorded, world)
        yield from checks.end(recorded, world, scene_start)
    if with_replay:
        yield from replay(episode)


def keep_verdict(episode: StoredEpisode, verdict: EpisodeVerdict) -> None:
    """Write a verdict into its episode's folder.

    Raises:
        OSError: The folder cannot be written.
    """
    write_json(episode.path / AUDIT, {"schema": SCHEMA, "content": episode.content_hash, **verdict.to_json()})


def kept_verdict(episode: StoredEpisode) -> EpisodeVerdict | None:
    """Return the verdict on an episode's present content; None where there is none."""
    kept = episode.audited
    if kept is None or kept.get("schema") != SCHEMA:
        return None
    try:
        return EpisodeVerdict.from_json(kept)
    except (KeyError, TypeError):
        return None


def auditable(store: EpisodeStore) -> Iterator[StoredEpisode]:
    """Yield the episodes that can be audited: those with motion, and those that claim a success.

    Raises:
        NotADataset: One of them is unreadable.
    """
    return (episode for episode in store.episodes() if episode.has_samples or episode.succeeded)


def audit_store(
    store: EpisodeStore,
    *,
    with_replay: bool = True,
    workers: int = 1,
    again: bool = False,
    on_progress: OnProgress = ignore_progress,
) -> Iterator[EpisodeVerdict]:
    """Yield the verdict on every episode of a store, and write it into the store; those that are there count.

    Args:
        store: The store.
        with_replay: Whether commands are repeated.
        workers: Number of processes; one does it in this process.
        again: Whether to audit what was audited.
        on_progress: Called with the numbers of audited and of all episodes.

    Raises:
        NotADataset: An episode is unreadable.
        OSError: The store cannot be written.
    """
    left: list[str] = []
    episodes = list(auditable(store))
    for episode in episodes:
        kept = None if again else kept_verdict(episode)
        if kept is None or (with_replay and not kept.replayed):
            left.append(episode.name)
        else:
            yield kept
    done = len(episodes) - len(left)
    with closing(_audited(store, left, with_replay, min(workers, len(left)))) as verdicts:
        for verdict in verdicts:
            keep_verdict(store.episode(verdict.episode), verdict)
            done += 1
            on_progress(done, len(episodes))
            yield verdict


def _audited(
    store: EpisodeStore, names: Sequence[str], with_replay: bool, workers: int
) -> Generator[EpisodeVerdict, None, None]:
    if workers <= 1:
        for name in names:
            yield audit_episode(store.episode(name), with_replay=with_replay)
        return
    asked = [{"store": str(store.path.absolute()), "episode": name, "with_replay": with_replay} for name in names]
    with closing(WorkerPool(WORKER, workers, environment={"OMP_NUM_THREADS": "1"}).run(asked)) as outcomes:
        for outcome in outcomes:
            if outcome.ending == "finished":
                yield EpisodeVerdict.from_json(outcome.answer)
            elif outcome.ending == "error" and outcome.answer.get("kind") == NotADataset.__name__:
                raise NotADataset(str(outcome.answer.get("error", outcome.message)))
            else:
                # The engine itself does not survive some forged states.
                finding = Finding("unreadable", f"the process that read it ended: {outcome.message}")
                yield EpisodeVerdict.of(outcome.request["episode"], [finding], replayed=with_replay)


def count_kinds(verdicts: Iterable[EpisodeVerdict]) -> Counter[str]:
    """Return in how many episodes each kind was found."""
    return Counter(kind for verdict in verdicts for kind in verdict.kinds)
