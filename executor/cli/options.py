"""What can be typed: one class a sub-command. Nothing but the standard library and tyro is loaded to read it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]


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
class Evolve:
    """Execute a task file, and revise the flows that fail until they succeed or nothing is left to try."""

    task: tyro.conf.Positional[Path]
    """The task's JSON file; numbers in its flows are run as they are written."""
    scene: str
    """Name of a scene that comes with the package, or a scene's JSON file."""
    seed: int = 0
    """Seed of the first episode; the following ones count up."""
    episodes: int = 1
    """How many episodes to run."""
    limit: int = 5
    """How many revisions a subtask may have."""
    out: Path | None = None
    """Folder for results: one folder an episode, named by its seed."""
    force: Flag = False
    """Replace results that the folder already has."""
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


Options = Run | Rollout | Evolve | Verify | Graph | Recheck | Doctor | Scenes | Assets | Check | Fmt
SubCommand = (
    Annotated[Run, tyro.conf.subcommand("run")]
    | Annotated[Rollout, tyro.conf.subcommand("rollout")]
    | Annotated[Evolve, tyro.conf.subcommand("evolve")]
    | Annotated[Verify, tyro.conf.subcommand("verify")]
    | Annotated[Graph, tyro.conf.subcommand("graph")]
    | Annotated[Recheck, tyro.conf.subcommand("recheck")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
    | Annotated[Scenes, tyro.conf.subcommand("scenes")]
    | Annotated[Assets, tyro.conf.subcommand("assets")]
    | Annotated[Bddl, tyro.conf.subcommand("bddl")]
)
