"""What can be typed to `evolve` and `ablate`: who judges failed attempts, and what is revised or compared."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from executor.cli.options.flag import Flag, Maybe, unless


@dataclass(frozen=True)
class Judged:
    """Who judges the steps of a failed attempt and revises its flow."""

    model: Maybe[str] = None
    """Language model that judges and revises, such as openai:gpt-5.2 or replay:FILE; by default measurements do."""
    max_tokens: Maybe[int] = None
    """Most tokens that the model may use."""
    max_cost_usd: Maybe[float] = None
    """Most US dollars that the model may cost, where its price is known."""
    max_time_s: Maybe[float] = None
    """Most seconds that the model may take."""
    views: str = "global,head,wrist"
    """Cameras whose pictures the model sees, with commas between them; none: it is told measurements only."""
    look_back: int = 1
    """How many steps before the judged one the model sees as well."""
    measurements: Annotated[Flag, unless("Show the model pictures only, and not what was measured.")] = True
    """Whether the model is told what was measured, beside the pictures."""
    most_pictures: Maybe[int] = None
    """Most pictures in a question; by default 36 for a step, 24 for a revision."""
    memory: Maybe[Path] = None
    """Folder of notes: corrections that helped before are tried first, and new ones are written down."""


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
    fault: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="KIND:...")] = ()
    """What is wrong on purpose, such as pose:glass_0,size_m=0.02 or grip:force_n=2; may be given several times."""
    judged: Judged = field(default_factory=Judged)
    out: Maybe[Path] = None
    """Folder for results: one folder an episode, named by its seed."""
    resume: Flag = False
    """Keep the finished episodes that the folder has, and run the others."""
    pictures: Flag = False
    """Draw the failed steps of all attempts for the report; needs a renderer."""
    force: Flag = False
    """Replace results that the folder already has."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Ablate:
    """Compare what a model sees in self-evolution: cameras, or how many steps it looks back. Needs a model.

    Every setting runs the same episodes; the table has success, revisions, tokens and waiting times. Notes of --memory
    are shown to the model, and none are written, so that no setting profits from another.
    """

    what: tyro.conf.Positional[Literal["views", "look-back"]]
    """What is varied: the subsets of the three cameras, or 0, 1 and 2 steps back."""
    task: tyro.conf.Positional[Path]
    """The task's JSON file; numbers in its flows are run as they are written."""
    scene: str
    """Name of a scene that comes with the package, or a scene's JSON file."""
    seed: int = 0
    """Seed of the first episode; the following ones count up."""
    episodes: int = 1
    """How many episodes to run in each setting."""
    limit: int = 5
    """How many revisions a subtask may have."""
    judged: Judged = field(default_factory=Judged)
    out: Maybe[Path] = None
    """Folder for the table, the recording and the pictures."""
    force: Flag = False
    """Replace results that the folder already has."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""
