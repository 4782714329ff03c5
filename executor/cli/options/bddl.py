"""What can be typed to `bddl check` and `bddl fmt`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from executor.cli.options.flag import Flag

Files = tyro.conf.Positional[
    Annotated[tuple[str, ...], tyro.conf.arg(metavar="FILE...", help_behavior_hint="(required)")]
]


@dataclass(frozen=True)
class Check:
    """Examine BDDL files: what is wrong in them, and what is legal but suspicious.

    The exit code is 0 when nothing is wrong, 1 when something is, 2 when a file cannot be read.
    """

    files: tyro.conf.Positional[
        Annotated[tuple[str, ...], tyro.conf.arg(metavar="FILE...", help_behavior_hint="(required)")]
    ]
    """Files, folders with files that end in .bddl, or - for the standard input."""
    profile: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
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

    files: tyro.conf.Positional[
        Annotated[tuple[str, ...], tyro.conf.arg(metavar="FILE...", help_behavior_hint="(required)")]
    ]
    """Files, folders with files that end in .bddl, or - for the standard input."""
    profile: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
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
