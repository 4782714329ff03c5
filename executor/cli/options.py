"""What can be typed: one class a sub-command. Nothing but the standard library and tyro is loaded to read it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from executor.cli.evolution_options import Ablate, Evolve
from executor.cli.flag import Flag

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
    model: str | None = None
    """Language model that plans, such as openai:gpt-5.2, ollama:qwen3-vl or replay:FILE; by default none does."""
    max_tokens: int | None = None
    """Most tokens that the model may use."""
    max_cost_usd: float | None = None
    """Most US dollars that the model may cost, where its price is known."""
    max_time_s: float | None = None
    """Most seconds that the model may take."""
    seed: int = 0
    """Varies the scene and seeds the planning."""
    evolve: Flag = False
    """Revise the flows that fail, by measurements, or by the model where there is one."""
    limit: int = 5
    """How many revisions a subtask may have."""
    memory: Path | None = None
    """With --evolve: folder of notes on corrections that helped before; new ones are written down."""
    force: Flag = False
    """Replace results that the folder already has."""
    video: Flag = True
    """Draw pictures and the video."""
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
    workers: int = 1
    """How many processes to run them in; one that crashes costs its episode only."""
    out: Path | None = None
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

    families: tyro.conf.Positional[Annotated[tuple[Family, ...], tyro.conf.arg(metavar="T1..T6")]]
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
    rule: Flag = True
    """Ask the kinematic rule which pairs no stance can reach, before they are executed; it changes no outcome."""
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
    video: Flag = True
    """Draw pictures and the video."""
    size: tuple[int, int] = (224, 224)
    """Width and height of the robot's views; the overview is drawn twice as large."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Verify:
    """Decide whether a task's plan reaches its goal, without moving anything."""

    task: tyro.conf.Positional[Path]
    """The task's JSON file."""
    scene: str | None = None
    """Name of a scene or a scene's JSON file; by default `<task>_scene.json` or `scene.json` beside the task."""
    out: Path | None = None
    """File for the task: with a fix applied when the plan is refuted, else with the flows that were searched; its
    folder is made when absent."""
    apply: int | None = None
    """Which fix to apply, by its number; by default the first, which is the smallest that proves the plan."""
    certificate: Path | None = None
    """File for the certificate, which `recheck` checks; its folder is made when absent."""
    force: Flag = False
    """Replace the file when it exists."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Graph:
    """Draw the object-action graph of a task, or write it for other tools."""

    task: tyro.conf.Positional[Path]
    """The task's JSON file."""
    scene: str | None = None
    """Name of a scene or a scene's JSON file; by default `<task>_scene.json` or `scene.json` beside the task."""
    format: Literal["svg", "mermaid", "dot", "graphml", "json"] = "svg"
    """What to write: a picture, or text for Mermaid, Graphviz, graph editors or programs."""
    out: Path | None = None
    """The file to write, its folder made when absent; by default standard output."""
    force: Flag = False
    """Replace the file when it exists."""
    json: Flag = False
    """The same as `--format json`."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Recheck:
    """Check a certificate without trusting the verifier that wrote it."""

    certificate: tyro.conf.Positional[Path]
    """The certificate's JSON file, or that of a report: what `verify --json` prints."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Doctor:
    """Examine this machine: what works, what is missing, what to do."""

    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Scenes:
    """List the scenes that come with the package."""

    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Assets:
    """List the models that a scene's objects can name, with their ranges."""

    sheet: Path | None = None
    """File for a picture of all of them, one variation each; needs a renderer."""
    seed: int = 0
    """Which variation the picture shows."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class ImportAsset:
    """Make a model for scenes of a URDF, a PartNet-Mobility folder or a mesh, and tell what a robot can do with it."""

    source: tyro.conf.Positional[Path]
    """A .urdf file, a folder with mobility.urdf, or an OBJ, STL, PLY, glTF or DAE mesh."""
    name: str | None = None
    """Its name; scenes say imported/NAME. By default that of the source."""
    category: str | None = None
    """What it is, such as cabinet or mug; by default what the files say, else its name."""
    height_m: float | None = None
    """Its height in metres; by default the files' lengths are metres."""
    side: Path | None = None
    """JSON file with what overrules inference; by default affordances.json beside the source."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Check:
    """Examine BDDL files: what is wrong in them, and what is legal but suspicious.

    The exit code is 0 when nothing is wrong, 1 when something is, 2 when a file cannot be read.
    """

    files: tyro.conf.Positional[Annotated[tuple[str, ...], tyro.conf.arg(metavar="FILE...")]]
    """Files, folders with files that end in .bddl, or - for the standard input."""
    profile: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The dialect: scene, behavior, behavior-compat or libero; by default the one that the file's domain belongs to."""
    strict: Flag = False
    """Count warnings as mistakes."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Fmt:
    """Lay out BDDL files anew; every word and every comment stays.

    The exit code is 0 when all is well, 1 when a file has mistakes or, with --check, another layout.
    """

    files: tyro.conf.Positional[Annotated[tuple[str, ...], tyro.conf.arg(metavar="FILE...")]]
    """Files, folders with files that end in .bddl, or - for the standard input."""
    profile: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The dialect: scene, behavior, behavior-compat or libero; by default the one that the file's domain belongs to."""
    check: Flag = False
    """Change nothing; name the files that would change."""
    write: Flag = False
    """Write the files instead of printing them."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


BddlCommand = Annotated[Check, tyro.conf.subcommand("check")] | Annotated[Fmt, tyro.conf.subcommand("fmt")]


@dataclass(frozen=True)
class Bddl:
    """Examine BDDL files, or lay them out anew."""

    command: BddlCommand


Options = (
    Run
    | Rollout
    | Evolve
    | Ablate
    | Bench
    | Replay
    | Verify
    | Graph
    | Recheck
    | Doctor
    | Scenes
    | Assets
    | ImportAsset
    | Check
    | Fmt
)
SubCommand = (
    Annotated[Run, tyro.conf.subcommand("run")]
    | Annotated[Rollout, tyro.conf.subcommand("rollout")]
    | Annotated[Evolve, tyro.conf.subcommand("evolve")]
    | Annotated[Ablate, tyro.conf.subcommand("ablate")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
    | Annotated[Replay, tyro.conf.subcommand("bench-replay")]
    | Annotated[Verify, tyro.conf.subcommand("verify")]
    | Annotated[Graph, tyro.conf.subcommand("graph")]
    | Annotated[Recheck, tyro.conf.subcommand("recheck")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
    | Annotated[Scenes, tyro.conf.subcommand("scenes")]
    | Annotated[Assets, tyro.conf.subcommand("assets")]
    | Annotated[ImportAsset, tyro.conf.subcommand("assets-import")]
    | Annotated[Bddl, tyro.conf.subcommand("bddl")]
)
