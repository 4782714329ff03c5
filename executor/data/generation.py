"""Generate a data set: read its plan (families, or sentences in scenes), and make the missing units in processes.

    seed: 0
    episodes: 100
    vary: [target, surfaces]
    views: [head, wrist]
    sources:
      - families: [T1, T2]
        episodes: 500
      - query: put the apple into the bowl
        scene: kitchen_t3

Keys outside `sources` hold for all sources, unless a source sets them itself.
"""

from __future__ import annotations

import re
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, StrictBool, StrictFloat, StrictInt, ValidationError

from bddl.files import read_bounded_text
from executor.campaign.engine import Campaign, Job
from executor.campaign.planning_model import ModelWatch
from executor.data.store import EpisodeStore
from executor.data.units import (
    MOST_STANCES,
    DemoSeries,
    DemoUnit,
    Origin,
    Recording,
    Repair,
    Side,
    Variation,
    View,
    scene_key,
)
from executor.scenes.file import scene_for
from executor.scenes.generators.families import Family, Flows, indices_of, varies_with_seed
from executor.scenes.validation import require_valid
from executor.scenes.vary import LARGEST_SEED, MOST_EPISODES
from executor.system.extras import require
from oag.model.codec import Document
from oag.model.diagnostics import InputError
from oag.model.forms import Form, first_mistake
from oag.model.robots import chosen_robot, known_robot

Axis = Literal["target", "surfaces", "lights", "cameras", "physics"]
AXES: tuple[Axis, ...] = ("target", "surfaces", "lights", "cameras", "physics")
Number = StrictFloat | StrictInt
ATTEMPTS_EACH = 10
"""Episodes that are tried for a wanted success."""
_WITH_EXPONENT = re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$")


class PlanError(InputError, ValueError):
    """A file is no plan of a data set."""

    what = "plan"


class _SourceOptions(Form):
    """Options of all sources, or of one."""

    seed: Annotated[StrictInt, Field(ge=0, le=LARGEST_SEED)] = 0
    episodes: Annotated[StrictInt, Field(ge=1, le=MOST_EPISODES)] = 20
    successes: Annotated[StrictInt, Field(ge=1, le=MOST_EPISODES)] | None = None
    vary: tuple[Axis, ...] = ()
    distractors: Annotated[StrictInt, Field(ge=0, le=8)] = 0
    noise_m: Annotated[Number, Field(ge=0, le=0.05)] = 0
    views: tuple[View, ...] = ()
    size: tuple[Side, Side] = (128, 128)
    plain: StrictBool = False
    rate_hz: Annotated[Number, Field(ge=1, le=250)] = 10
    depth: StrictBool = True
    segmentation: StrictBool = True
    failures: StrictBool = False
    evolve: StrictBool = False
    flows: Flows = "planned"
    keep_sizes: StrictBool = False
    full_size: StrictBool = False
    robot: Annotated[str, AfterValidator(known_robot)] = ""
    stances: Annotated[StrictInt, Field(ge=1, le=MOST_STANCES)] = 1
    repair: Repair | None = None


def attempts_for(successes: int | None) -> int:
    """Return how many episodes are tried where their number is not given.

    Args:
        successes: Wanted successes; None where none are counted.
    """
    usual: int = _SourceOptions.model_fields["episodes"].default
    return usual if successes is None else min(ATTEMPTS_EACH * successes, MOST_EPISODES)


class _SourceForm(_SourceOptions):
    families: tuple[Family, ...] = ()
    query: str = ""
    scene: str = ""


class _PlanForm(_SourceOptions):
    sources: Annotated[tuple[dict[str, Any], ...], Field(min_length=1)]


def read_plan(path: Path, defaults: Mapping[str, object] = MappingProxyType({})) -> tuple[DemoSeries, ...]:
    """Read the series of a YAML plan; scene files are relative to it.

    Args:
        path: The file.
        defaults: Defaults of all sources, where the file has none.

    Raises:
        PlanError: The file is unreadable, or no plan.
        MissingExtra: PyYAML is not installed.
        SceneError, SceneNotFound: A scene cannot be read.
    """
    yaml = require("yaml", "data")
    try:
        content = yaml.load(read_bounded_text(path), _loader(yaml.SafeLoader))
    except OSError as problem:
        raise PlanError(f"cannot be read: {problem.strerror or problem}", source=str(path)) from None
    except RecursionError:
        raise PlanError("is not YAML of a plan: it is nested too deeply", source=str(path)) from None
    except (yaml.YAMLError, UnicodeDecodeError) as problem:
        mark = getattr(problem, "problem_mark", None)
        place = f" at line {mark.line + 1}, column {mark.column + 1}" if mark is not None else ""
        raise PlanError(f"is not YAML: {getattr(problem, 'problem', problem)}{place}", source=str(path)) from None
    return series_of({**defaults, **content} if isinstance(content, dict) else content, str(path), path.parent)


@cache
def _loader(safe: type) -> Any:
    """Return a safe loader that reads 1e1 as YAML 1.2, TOML and command lines do; plain YAML takes it for text.

    Args:
        safe: The library's own safe loader.
    """
    loader: Any = type("Loader", (safe,), {})
    loader.add_implicit_resolver("tag:yaml.org,2002:float", _WITH_EXPONENT, [*"-+0123456789"])
    return loader


def series_of(wanted: object, source: str = "(options)", scene_folder: Path = Path()) -> tuple[DemoSeries, ...]:
    """Return the series that a plan requests.

    Args:
        wanted: The plan as plain data.
        source: Its name in messages.
        scene_folder: Folder of its scene files.

    Raises:
        PlanError, SceneError, SceneNotFound: As for `read_plan`.
    """
    document = Document(wanted, source, PlanError)
    plan = document.read(_PlanForm)
    shared = plan.model_dump(exclude={"sources"}, exclude_unset=True)
    found: list[DemoSeries] = []
    for number, given in enumerate(plan.sources):
        merged = Document({"sources": {number: {**shared, **given}}}, source, PlanError)
        one = merged.read(_SourceForm, "sources", number)
        if bool(one.families) is bool(one.query or one.scene) or bool(one.query) is not bool(one.scene):
            raise document.fail(("sources", number), "expected families, or a query and a scene")
        try:
            found += _series_of_source(one, scene_folder)
        except ValidationError as problem:
            raise document.fail(("sources", number), first_mistake(problem)) from None
        except ValueError as problem:
            if isinstance(problem, InputError):
                raise
            raise document.fail(("sources", number), str(problem)) from None
    return tuple(found)


def _series_of_source(wanted: _SourceForm, scene_folder: Path) -> Iterator[DemoSeries]:
    axes = {axis: axis in wanted.vary for axis in AXES}
    variation = Variation(**axes, distractors=wanted.distractors, noise_m=wanted.noise_m)
    pictured = (wanted.views, wanted.size, wanted.depth, wanted.segmentation)
    home = bool(wanted.views) and not wanted.plain
    recording = Recording(wanted.rate_hz, *pictured, wanted.failures, home)
    episodes = wanted.episodes if "episodes" in wanted.model_fields_set else attempts_for(wanted.successes)
    for origin, robot in _origins(wanted, scene_folder):
        index = indices_of(origin.family)[0]
        flags = (wanted.evolve, wanted.flows, wanted.keep_sizes, wanted.full_size, wanted.stances)
        yield DemoSeries(
            DemoUnit(origin, wanted.seed, index, variation, recording, *flags, robot=robot, repair=wanted.repair),
            episodes,
            wanted.successes,
        )


def _origins(wanted: _SourceForm, scene_folder: Path) -> Iterator[tuple[Origin, str]]:
    """Yield origins, each with the name of a robot that keeps no order, or of the chosen one."""
    if wanted.families:
        yield from ((Origin(family=family), wanted.robot) for family in wanted.families)
        return
    file = scene_folder / wanted.scene
    name = str(file) if wanted.scene.endswith(".json") else wanted.scene
    if varies_with_seed(name):
        # Scenes drawn by seeds follow from the seeds and the program.
        yield Origin(query=wanted.query, scene=name), wanted.robot
        return
    scene = scene_for(wanted.query, name, robot=chosen_robot(wanted.robot, full_size=wanted.full_size))
    require_valid(scene)
    origin = Origin(query=wanted.query, scene=name, scene_key=scene_key(scene))
    yield origin, wanted.robot if scene.robot.model.keeps_order else scene.robot.name


WORKER = "executor.data.worker"
_ROOM_LEFT_BYTES = 200_000_000  # Reserve of disk space: a full disk makes everything else on it fail, too.


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a run; units in flight at a limit are lost.

    Attributes:
        wall_s: Wall time of this run [s]; None for no limit.
        store_bytes: Bytes that the run may add to the disk; None for no limit.
    """

    wall_s: float | None = None
    store_bytes: int | None = None


NO_LIMITS = Limits()


@dataclass
class Tally:
    """Counts of the units so far.

    Attributes:
        endings: Units by ending: succeeded, failed, crashed...
        kinds: Failures by kind.
        added_bytes, cpu_s: Cost of this run's units.
        began: Start of the run, by `time.perf_counter`.
        stopped_by: Limit that ended the run; empty when none did.
    """

    endings: Counter[str] = field(default_factory=Counter)
    kinds: Counter[str] = field(default_factory=Counter)
    made: int = 0
    kept: int = 0
    added_bytes: int = 0
    cpu_s: float = 0.0
    began: float = field(default_factory=time.perf_counter)
    stopped_by: str = ""

    def count(self, result: Mapping[str, Any]) -> None:
        """Count a unit of this run."""
        self.note(result["ended"], result.get("kind"))
        self.made += 1
        self.kept += result["ended"] == "succeeded"
        self.added_bytes += result.get("bytes", 0)
        self.cpu_s += result.get("cpu_s", 0.0)

    def note(self, ended: str, kind: str | None) -> None:
        """Count a unit of any run."""
        self.endings[ended] += 1
        if ended != "succeeded" and kind:
            self.kinds[kind] += 1

    @property
    def kept_an_hour(self) -> float:
        """Successes per hour of wall time, of this run."""
        return 3600.0 * self.kept / max(time.perf_counter() - self.began, 1e-9)


class Goals:
    """Successes that are wanted of each series, and what there is of them.

    Args:
        series: The series; those that want no number of successes want all their units.
    """

    def __init__(self, series: Sequence[DemoSeries]) -> None:
        self._limits = [one.successes for one in series]
        self._there = [0] * len(series)
        limited = [place for place, limit in enumerate(self._limits) if limit is not None]
        self._series_of = {unit: place for place in limited for unit in series[place].units()}

    @property
    def wanted(self) -> int:
        """Successes that are wanted in all; 0 where a series wants all its units."""
        numbers = [limit or 0 for limit in self._limits]
        return sum(numbers) if all(numbers) else 0

    @property
    def there(self) -> int:
        """Successes that count towards those that are wanted."""
        return sum(min(there, limit or 0) for there, limit in zip(self._there, self._limits, strict=True))

    def note(self, unit: DemoUnit, ended: str) -> None:
        """Count a unit that ended."""
        if ended == "succeeded" and unit in self._series_of:
            self._there[self._series_of[unit]] += 1

    def wants(self, unit: DemoUnit) -> bool:
        """Decide whether a unit is still to be made."""
        place = self._series_of.get(unit)
        limit = None if place is None else self._limits[place]
        return place is None or limit is None or self._there[place] < limit


EpisodeCallback = Callable[[DemoUnit, Mapping[str, Any]], None]


def generate(
    campaign: Campaign[DemoUnit],
    jobs: Sequence[Job[DemoUnit]],
    on_progress: EpisodeCallback,
    tally: Tally,
    limits: Limits = NO_LIMITS,
    goals: Goals | None = None,
) -> None:
    """Make units; each is completely in the store before it is reported.

    Args:
        campaign: Worker processes, and the destination.
        jobs: Missing units, in their order of start; no other run works on them (`claimed`).
        on_progress: Called with every unit and its result.
        tally: Counts them.
        limits: Limits of the run.
        goals: Successes that are wanted; by default all units are.

    Raises:
        WorkersUnusable, OSError, KeyboardInterrupt: As for `Campaign.run`.
    """
    store = EpisodeStore(campaign.store.path)
    # These units are claimed by this run; partial results of other units are judged by age.
    store.tidy({unit.folder(version) for unit, version in jobs}, 2.0 * campaign.limit_s)

    watch = ModelWatch()

    def count(unit: DemoUnit, result: Mapping[str, Any]) -> None:
        if not watch.note(result.get("kind")):
            return
        tally.count(result)
        if goals is not None:
            goals.note(unit, result["ended"])
        on_progress(unit, result)

    def stop() -> bool:
        tally.stopped_by = _exhausted_limit(store, tally, limits) if tally.made < len(jobs) else ""
        return bool(tally.stopped_by)

    campaign.run(jobs, count, stop, lambda unit: not watch.why and (goals is None or goals.wants(unit)))
    tally.stopped_by = tally.stopped_by or watch.why


def _exhausted_limit(store: EpisodeStore, tally: Tally, limits: Limits) -> str:
    if limits.wall_s is not None and time.perf_counter() - tally.began >= limits.wall_s:
        return "time"
    if limits.store_bytes is not None and tally.added_bytes >= limits.store_bytes:
        return "disk budget"
    if shutil.disk_usage(store.path).free < _ROOM_LEFT_BYTES:
        return "room on the disk"
    return ""
