"""What can be typed to the sub-commands that are about plans alone, in the manner of `options`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from executor.cli.words.shared import READ_SCENE, CommonOptions, Flag, Maybe, Read, ReplaceFile, SceneBeside, TaskFile


@dataclass(frozen=True)
class VerifyOptions(CommonOptions):
    """Decide whether a task's plan reaches its goal, without moving anything."""

    task: TaskFile
    scene: SceneBeside = None
    out: Maybe[Path] = None
    """File for the task: with a fix applied when the plan is refuted, else with the flows that were searched; its
    folder is made when absent."""
    apply: Maybe[int] = None
    """Which fix to apply, by its number; by default the first, which is the smallest that proves the plan."""
    certificate: Maybe[Path] = None
    """File for the certificate, which `recheck` checks; its folder is made when absent."""
    force: ReplaceFile = False


@dataclass(frozen=True)
class GraphOptions(CommonOptions):
    """Draw the object-action graph of a task, or write it for other tools."""

    task: TaskFile
    scene: SceneBeside = None
    format: Maybe[Literal["svg", "mermaid", "dot", "graphml", "json"]] = None
    """What to write: a picture, or text for Mermaid, Graphviz, graph editors or programs; by default what the ending of
    --out says (.svg .mmd .dot .graphml .json), or a picture."""
    out: Maybe[Path] = None
    """The file to write, its folder made when absent; by default standard output."""
    force: ReplaceFile = False
    json: Flag = field(default=False, kw_only=True)
    """The same as `--format json`."""


@dataclass(frozen=True)
class RecheckOptions(CommonOptions):
    """Check a certificate without trusting the verifier that wrote it."""

    certificate: tyro.conf.Positional[Annotated[Path, Read("certificate")]]
    """The certificate's JSON file, or that of a report: what `verify --json` prints."""
    task: Annotated[Maybe[Path], Read("task")] = None
    """The task's JSON file that it has to be about; by default any."""
    scene: Annotated[Maybe[str], READ_SCENE] = None
    """Name of the scene, or the scene's JSON file, that it has to be about; by default any."""
