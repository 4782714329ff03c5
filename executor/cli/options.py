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
class Verify:
    """Decide whether a task's plan reaches its goal, without moving anything."""

    task: tyro.conf.Positional[Path]
    """The task's JSON file."""
    scene: str | None = None
    """Name of a scene or a scene's JSON file; by default `<task>_scene.json` or `scene.json` beside the task."""
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
    """The file to write; by default standard output."""
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
    """The certificate's JSON file."""
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


Options = Run | Rollout | Verify | Graph | Recheck | Doctor | Scenes
SubCommand = (
    Annotated[Run, tyro.conf.subcommand("run")]
    | Annotated[Rollout, tyro.conf.subcommand("rollout")]
    | Annotated[Verify, tyro.conf.subcommand("verify")]
    | Annotated[Graph, tyro.conf.subcommand("graph")]
    | Annotated[Recheck, tyro.conf.subcommand("recheck")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
    | Annotated[Scenes, tyro.conf.subcommand("scenes")]
)
