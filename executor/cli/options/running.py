"""What can be typed to the sub-commands that execute plans: `run`, `rollout`, `bench` and `bench replay`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from executor.cli.options.flag import Flag, Maybe, unless

Family = Literal["T1", "T2", "T3", "T4", "T5", "T6"]


@dataclass(frozen=True)
class Run:
    """Turn a sentence and a scene into a verified plan, a rollout, a video and a dataset."""

    query: tyro.conf.Positional[str]
    """What the robot is to do, such as "put the glass into the refrigerator"."""
    scene: str
    """Name of a scene that comes with the package, or a scene's JSON file."""
    out: Path
    """Folder for the results."""
    model: Maybe[str] = None
    """Language model that plans, such as openai:gpt-5.2, ollama:qwen3-vl or replay:FILE; by default none does."""
    max_tokens: Maybe[int] = None
    """Most tokens that the model may use."""
    max_cost_usd: Maybe[float] = None
    """Most US dollars that the model may cost, where its price is known."""
    max_time_s: Maybe[float] = None
    """Most seconds that the model may take."""
    image: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction] = ()
    """With --model: picture of the scene that the model sees with the query; may be given several times."""
    seed: int = 0
    """Varies the scene and seeds the planning."""
    evolve: Flag = False
    """Revise the flows that fail, by measurements, or by the model where there is one."""
    limit: int = 5
    """How many revisions a subtask may have."""
    memory: Maybe[Path] = None
    """With --evolve: folder of notes on corrections that helped before; new ones are written down."""
    force: Flag = False
    """Replace results that the folder already has."""
    video: Annotated[Flag, unless("Draw no pictures and no video.")] = True
    """Whether pictures and the video are drawn."""
    size: tuple[int, int] = (224, 224)
    """Width and height of the robot's views; the overview is drawn twice as large."""
    record_hz: float = 10.0
    """Recorded samples a second of simulated time."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Rollout:
    """Execute a task file in the physics, over one or more seeds, and count successes."""

    task: tyro.conf.Positional[Path]
    """The task's JSON file; numbers in its flows are run as they are written."""
    scene: str
    """Name of a scene that comes with the package, or a scene's JSON file."""
    seed: int = 0
    """Seed of the first episode; the following ones count up."""
    episodes: int = 1
    """How many episodes to run."""
    open_numbers: Flag = False
    """Leave all numbers of the flows to the planner, so that every episode has its own."""
    workers: int = 1
    """How many processes to run them in; one that crashes costs its episode only."""
    out: Maybe[Path] = None
    """Folder for results: one folder an episode, named by its seed."""
    force: Flag = False
    """Replace results that the folder already has."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Bench:
    """Measure success rates over many episodes, and print them beside the paper's main table.

    Goes on where an earlier run with the same folder ended. `scene2demo bench replay FOLDER UNIT --out OTHER` shows
    one unit as a video.
    """

    families: tyro.conf.Positional[
        Annotated[tuple[Family, ...], tyro.conf.arg(metavar="T1..T6", help_behavior_hint="(required)")]
    ]
    """What to measure: T1 to T4 are the long-horizon tasks, T5 opening and closing, T6 picking and placing."""
    out: Path
    """Folder for the results."""
    episodes: int = 20
    """How many units of each family; those of T5 and T6 go through one set of pairs after the other."""
    seed: int = 0
    """Seed of the first episode, or of the first set of pairs; the following ones count up."""
    workers: int = 2
    """How many processes; one that crashes costs its unit only."""
    flows: Literal["planned", "paper"] = "planned"
    """The offline planner's flows, whose numbers geometry fills in, or the paper's initial flows, numbers verbatim."""
    evolve: Flag = False
    """Revise the flows that fail."""
    views: Flag = False
    """Draw three cameras' pictures of every success (color, depth, segmentation), for the time that it takes."""
    rule: Annotated[
        Flag,
        unless(
            "Leave out the kinematic rule, which says before a unit runs whether any stance can reach; outcomes stay."
        ),
    ] = True
    """Whether the kinematic rule is asked which pairs no stance can reach, before they are executed."""
    shard: str = "1/1"
    """Which part of the units to run, such as 3/8; all parts may share a folder."""
    again: Flag = False
    """Run units once more whose process crashed, hung, or met a mistake of the program."""
    limit_s: float = 900.0
    """Wall time that a unit may take before its process is ended."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Replay:
    """Run one unit of a benchmark again, and make a report with a video of it. The same as `bench replay`."""

    folder: tyro.conf.Positional[Path]
    """The benchmark's folder."""
    unit: tyro.conf.Positional[str]
    """The unit's name, as the report lists it, or the beginning of it."""
    out: Path
    """Folder for the results."""
    force: Flag = False
    """Replace results that the folder already has."""
    video: Annotated[Flag, unless("Draw no pictures and no video.")] = True
    """Whether pictures and the video are drawn."""
    size: tuple[int, int] = (224, 224)
    """Width and height of the robot's views; the overview is drawn twice as large."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""
