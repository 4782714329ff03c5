"""`scene2demo status`: how far a folder is that several runs, or several machines, fill."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from bddl.terminal import pluralize
from executor.cli.errors import DONE
from executor.cli.options import CommonOptions, Read
from executor.cli.output import print_json, say


@dataclass(frozen=True)
class Options(CommonOptions):
    """Tell how far `generate`, `bench` or `evaluate` is in a folder: done, running, lost, failures, rate, time left."""

    folder: tyro.conf.Positional[
        Annotated[
            Path,
            tyro.conf.arg(metavar="DIR", help="Their folder for results.", help_behavior_hint="(required)"),
            Read(),
        ]
    ]


def execute(options: Options) -> int:
    """Print how far the folder is; return 0."""
    from executor.cli.output import span_text
    from executor.view.progress import progress_of

    found = progress_of(options.folder)
    if options.json:
        print_json({"ok": True, "folder": str(options.folder), **found.to_json()})
        return DONE
    share = f" ({100 * found.done / found.asked:.0f} %)" if found.asked else ""
    endings = ", ".join(f"{count} {ending}" for ending, count in found.endings.most_common()) or "nothing yet"
    say(f"{'done':11} {found.done} of {found.asked}{share}: {endings}", style="bold")
    for kind, count in found.failures.most_common():
        say(f"{'failed':11} {count} x {kind}")
    if found.runs:
        hosts = pluralize(len({run.host for run in found.runs}), "machine")
        say(f"{'running':11} {pluralize(len(found.runs), 'run')} on {hosts}, {pluralize(found.running, 'unit')} left")
    if found.lost:
        say(f"{'lost':11} {pluralize(found.lost, 'unit')} of runs that ended; the same command makes them")
    if found.an_hour is not None:
        left = "" if found.left_s is None else f", {span_text(found.left_s)} left"
        say(f"{'rate':11} {found.an_hour:.0f} an hour{left}")
    return DONE
