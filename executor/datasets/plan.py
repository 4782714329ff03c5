"""What a data set is to have, as people write it: families, or sentences in scenes, each so many times.

    seed: 0
    episodes: 100
    vary: [target, surfaces]
    views: [head, wrist]
    sources:
      - families: [T1, T2]
        episodes: 500
      - query: put the apple into the bowl
        scene: kitchen_t3

Everything beside `sources` holds for all of them, unless a source says otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import Field, StrictBool, StrictFloat, StrictInt, ValidationError

from bddl.files import read_bounded_text
from executor.bench.units import HOUSEHOLD, Family, indices_of
from executor.datasets.units import MOST_STANCES, DemoSeries, DemoUnit, Origin, Recording, Side, View, scene_key
from executor.datasets.variation import Variation
from executor.machine.extras import require
from executor.scenes.drawn import is_of_seeds
from executor.scenes.plausible import require_possible
from executor.scenes.reading import scene_for
from executor.scenes.vary import LARGEST_SEED, MOST_EPISODES
from oag.model.errors import InputError
from oag.model.forms import Form, first_mistake
from oag.model.jsonfile import Document

Axis = Literal["target", "surfaces", "lights", "cameras", "physics"]
AXES: tuple[Axis, ...] = ("target", "surfaces", "lights", "cameras", "physics")
Number = StrictFloat | StrictInt
_WITH_EXPONENT = re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$")


class PlanError(InputError, ValueError):
    """A file does not say what a data set is to have."""

    what = "plan"


class _Wishes(Form):
    """What may be said of all sources, or of one."""

    seed: Annotated[StrictInt, Field(ge=0, le=LARGEST_SEED)] = 0
    episodes: Annotated[StrictInt, Field(ge=1, le=MOST_EPISODES)] = 20
    vary: tuple[Axis, ...] = ()
    distractors: Annotated[StrictInt, Field(ge=0, le=8)] = 0
    noise_m: Annotated[Number, Field(ge=0, le=0.05)] = 0
    views: tuple[View, ...] = ()
    size: tuple[Side, Side] = (128, 128)
    rate_hz: Annotated[Number, Field(ge=1, le=250)] = 10
    depth: StrictBool = True
    segmentation: StrictBool = True
    failures: StrictBool = False
    evolve: StrictBool = False
    flows: Literal["planned", "paper"] = "planned"
    keep_sizes: StrictBool = False
    full_size: StrictBool = False
    stances: Annotated[StrictInt, Field(ge=1, le=MOST_STANCES)] = 1


class _Source(_Wishes):
    families: tuple[Family, ...] = ()
    query: str = ""
    scene: str = ""


class _Plan(_Wishes):
    sources: Annotated[tuple[dict[str, Any], ...], Field(min_length=1)]


def read_plan(path: Path, unsaid: Mapping[str, object] = MappingProxyType({})) -> tuple[DemoSeries, ...]:
    """Returns the series that a YAML file asks for; scenes that it names as files lie beside it.

    Args:
        path: The file.
        unsaid: What holds for all sources where the file does not say it.

    Raises:
        PlanError: The file cannot be read, or does not say what is to be made.
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
    return series_of({**unsaid, **content} if isinstance(content, dict) else content, str(path), path.parent)


@cache
def _loader(safe: type) -> Any:
    """Return a safe loader that reads 1e1 as YAML 1.2, TOML and command lines do; by itself it takes that for a text.

    Args:
        safe: The library's own safe loader.
    """
    loader: Any = type("Loader", (safe,), {})
    loader.add_implicit_resolver("tag:yaml.org,2002:float", _WITH_EXPONENT, [*"-+0123456789"])
    return loader


def series_of(wanted: object, source: str = "(options)", beside: Path = Path()) -> tuple[DemoSeries, ...]:
    """Returns the series that a plan asks for.

    Args:
        wanted: The plan as plain data.
        source: What it is called in messages.
        beside: Folder that scene files are looked for in.

    Raises:
        PlanError, SceneError, SceneNotFound: As for `read_plan`.
    """
    document = Document(wanted, source, PlanError)
    plan = document.read(_Plan)
    shared = plan.model_dump(exclude={"sources"}, exclude_unset=True)
    found: list[DemoSeries] = []
    for number, given in enumerate(plan.sources):
        merged = Document({"sources": {number: {**shared, **given}}}, source, PlanError)
        one = merged.read(_Source, "sources", number)
        if bool(one.families) is bool(one.query or one.scene) or bool(one.query) is not bool(one.scene):
            raise document.fail(("sources", number), "expected families, or a query and a scene")
        try:
            found += _series(one, beside)
        except ValidationError as problem:
            raise document.fail(("sources", number), first_mistake(problem)) from None
        except ValueError as problem:
            if isinstance(problem, InputError):
                raise
            raise document.fail(("sources", number), str(problem)) from None
    return tuple(found)


def _series(wanted: _Source, beside: Path) -> Iterator[DemoSeries]:
    axes = {axis: axis in wanted.vary for axis in AXES}
    variation = Variation(**axes, distractors=wanted.distractors, noise_m=wanted.noise_m)
    recording = Recording(wanted.rate_hz, wanted.views, wanted.size, wanted.depth, wanted.segmentation, wanted.failures)
    for origin in _origins(wanted, beside):
        index = indices_of(origin.family)[0] if origin.family in HOUSEHOLD else None
        said = (wanted.evolve, wanted.flows, wanted.keep_sizes, wanted.full_size, wanted.stances)
        yield DemoSeries(DemoUnit(origin, wanted.seed, index, variation, recording, *said), wanted.episodes)


def _origins(wanted: _Source, beside: Path) -> Iterator[Origin]:
    if wanted.families:
        yield from (Origin(family=family) for family in wanted.families)
        return
    file = beside / wanted.scene
    name = str(file) if wanted.scene.endswith(".json") else wanted.scene
    if is_of_seeds(name):
        # What seeds draw follows from them and from the program.
        yield Origin(query=wanted.query, scene=name)
        return
    scene = scene_for(wanted.query, name, full_size=wanted.full_size)
    require_possible(scene)
    yield Origin(query=wanted.query, scene=name, scene_key=scene_key(scene))
