"""Episodes of an evaluation as units of a campaign: one policy on one seed, each result a file, complete or absent.

DIR/evaluation-units.json        the units that were asked for
DIR/units/NAME-ID.json           outcome of a unit
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from executor.campaign.claims import exclusive_lock
from executor.campaign.engine import UNFINISHED, result_of
from executor.system.files import content_key, json_text, read_json, write_json
from executor.system.workers import WorkerOutcome

if TYPE_CHECKING:  # `status` reads the folder without torch.
    from executor.learn.acting import Policy
    from executor.learn.demonstrations import EpisodeKind
    from executor.learn.evaluation import EpisodeOutcome

SCHEMA = "scene2demo-evaluation-unit/1"
INDEX = "evaluation-units.json"
RESULTS = ("evaluation.json", INDEX)
"""Files of an evaluation, which may be in a policy's folder."""
WORKER = "executor.learn.evaluation_worker"
"""Module of the worker process."""


@dataclass(frozen=True, slots=True)
class EvaluationUnit:
    """One episode of one policy.

    Attributes:
        name: The policy's name in results.
        policy: Its folder.
        weights: Key of the files that the policy acts by.
        step: Step of training.
        execute: Executed actions of a chunk.
        data: What a stock policy was trained on; empty for trained policies of this program.
        kind: The episodes' kind, as JSON.
        seed: The episode's seed.
        threads: Threads of the network.
    """

    name: str
    policy: str
    weights: str
    step: int
    execute: int
    data: str
    kind: str
    seed: int
    threads: int = 1

    def id(self, version: str) -> str:
        """Return a key that changes whenever the outcome may."""
        parts = [self.weights, str(self.step), str(self.execute), self.kind, str(self.seed)]
        return content_key(SCHEMA, version, *parts)

    def file(self, version: str) -> str:
        """Return the name of its result's file."""
        return f"{Path(self.policy).name}-{self.step}-{self.seed:06d}-{self.id(version)[:8]}.json"


def units_of(
    actors: Sequence[Policy], kind: EpisodeKind, seeds: Sequence[int], data: Path | None, threads: int
) -> list[EvaluationUnit]:
    """Return the units of an evaluation, seed by seed."""
    from executor.learn.acting import LeRobotPolicy

    about = json_text(kind.to_json())
    keys = {(actor.folder, actor.step): _weights_key(actor) for actor in actors}
    return [
        EvaluationUnit(
            actor.name,
            actor.folder,
            keys[actor.folder, actor.step],
            actor.step,
            actor.execute,
            str(data) if isinstance(actor, LeRobotPolicy) else "",
            about,
            seed,
            threads,
        )
        for seed in seeds
        for actor in actors
    ]


def _weights_key(actor: Policy) -> str:
    """Return the key of the files that a policy acts by, wherever their folder is; logs and results do not count.

    Of a stock policy also what it learned from, by which it is observed.
    """
    from executor.learn.acting import LeRobotPolicy
    from executor.learn.policy_record import ABOUT, WEIGHTS, step_path

    folder = Path(actor.folder)
    if isinstance(actor, LeRobotPolicy):
        found = sorted(path for path in folder.iterdir() if path.suffix in (".json", ".safetensors"))
        files, learned = [path for path in found if path.name not in RESULTS], actor.record.data_key
    else:
        last = actor.step == actor.record.settings.training.steps
        files, learned = [folder / ABOUT, folder / WEIGHTS if last else step_path(folder, actor.step)], ""
    return content_key(learned, *(part for path in files for part in (path.name, path.read_bytes())))


@dataclass(frozen=True, slots=True)
class EvaluationFolder:
    """Folder of an evaluation's results; several machines may write into one at once.

    Attributes:
        path: The folder.
    """

    path: Path

    def add_units(self, units: Sequence[EvaluationUnit], version: str) -> None:
        """Add units to the list of what was asked for, once each."""
        with exclusive_lock(self.path):
            known = self.asked()
            known |= {unit.id(version): unit.file(version) for unit in units}
            write_json(self.path / INDEX, {"schema": SCHEMA, "units": known})

    def asked(self) -> dict[str, str]:
        """Return id -> file of the units that were asked for; empty without a list."""
        try:
            return {str(key): str(file) for key, file in read_json(self.path / INDEX)["units"].items()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return {}

    def read(self, unit: EvaluationUnit, version: str) -> Mapping[str, Any] | None:
        """Return a unit's result, or None when it was not run yet or its file is unreadable."""
        try:
            found = read_json(self.path / "units" / unit.file(version))
            return found if found["id"] == unit.id(version) else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def outcome(self, unit: EvaluationUnit, version: str) -> EpisodeOutcome | None:
        """Return the outcome of a unit's episode; None where it was not run, or its process did not finish."""
        from executor.learn.evaluation import EpisodeOutcome

        found = self.read(unit, version)
        return None if found is None or found["ended"] in UNFINISHED else EpisodeOutcome(**found["outcome"])

    def ending(self, unit: EvaluationUnit, version: str) -> str | None:
        """Return how a unit ended, or None when it was not run yet."""
        found = self.read(unit, version)
        return None if found is None else str(found["ended"])

    def request(self, unit: EvaluationUnit, version: str) -> dict[str, Any]:
        """Return the request of a unit to its worker process."""
        return {**asdict(unit), "version": version}

    def keep(self, unit: EvaluationUnit, version: str, outcome: WorkerOutcome) -> Mapping[str, Any]:
        """Write the outcome of a unit's process, and return the content of its file."""
        found = {"schema": SCHEMA, "id": unit.id(version), **asdict(unit), "version": version, **result_of(outcome)}
        (self.path / "units").mkdir(exist_ok=True)
        write_json(self.path / "units" / unit.file(version), found)
        return found


def kind_of_unit(unit: Mapping[str, Any]) -> EpisodeKind:
    """Return the kind of the episodes that a request is about."""
    from executor.learn.demonstrations import EpisodeKind
    from oag.model.forms import adapter

    found: EpisodeKind = adapter(EpisodeKind).validate_python(json.loads(unit["kind"]))
    return found
