"""What commands with many units share: the engine that runs them, and the array job of Slurm that does."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bddl.terminal import pluralize
from executor.cli.errors import DONE, check
from executor.cli.options import CommonOptions, Maybe
from executor.cli.output import print_json, say, tell

if TYPE_CHECKING:
    from executor.campaign.engine import EngineMaker


@dataclass(frozen=True, kw_only=True)
class EngineOptions(CommonOptions):
    """Which machines do the work."""

    slurm: Maybe[Path] = None
    """Write an array job of Slurm into this file instead, for `sbatch`: many small parts, started again where a
    machine is lost, and a last step that finds all done."""
    parts: Maybe[int] = None
    """With --slurm: how many parts; by default one for 20 units."""
    hours: float = 4.0
    """With --slurm: most hours that a part may take; what is left of it goes on in another start."""
    ray: Maybe[str] = None
    """Address of a Ray cluster, such as auto: every machine of it runs --workers processes on a shared folder."""


MOST_HOURS = 8760.0
NOT_OF_A_PART = ("slurm", "parts", "hours", "ray", "workers", "shard", "json", "debug")
"""Options that a part of an array job gets otherwise or not at all."""


def check_engine(options: EngineOptions, shard: str, out: Path | None) -> None:
    """Refuse options that do not go together, and paths that cannot be those of an array job."""
    check(options.parts is None or options.slurm is not None, "--parts", options.parts, "--slurm as well")
    check(options.parts is None or options.parts >= 1, "--parts", options.parts, "at least 1")
    most = f"a number above 0, at most {MOST_HOURS:g}, a year"
    check(0.0 < options.hours <= MOST_HOURS, "--hours", options.hours, most)
    others = [name for name, given in (("--ray", options.ray), ("--shard", shard != "1/1")) if given]
    check(options.slurm is None or not others, " and ".join(others), "with --slurm", "one of them")
    if options.slurm is not None:
        _check_script(options.slurm)
        place = str((out or Path()).absolute())
        legible = place.isprintable() and not set(place) & set('\\"')
        check(legible, "--out", ascii(str(out)), "with --slurm no control character, backslash or double quote")


def _check_script(file: Path) -> None:
    """Refuse a file that cannot be an array job, or that is something else already."""
    from executor.campaign.slurm import SCRIPT_BEGINS

    check(str(file.absolute()).isprintable(), "--slurm", ascii(str(file)), "a path without control characters")
    check(not file.is_dir(), "--slurm", file, "a file, not a folder")
    try:
        with file.open("rb") as there:
            ours = there.read(len(SCRIPT_BEGINS)) == SCRIPT_BEGINS.encode()
    except FileNotFoundError:
        return
    check(ours, "--slurm", file, "a file that does not exist yet, or an array job of this program, which is replaced")


def engine_of(options: EngineOptions, version: Callable[[], str], *, renders: bool) -> EngineMaker:
    """Return what makes the engine: that of this machine, or of a cluster.

    Args:
        options: The options.
        version: Returns the version of the program on any machine.
        renders: Whether machines have to be able to draw.

    Raises:
        MissingExtra: Ray is not installed.
    """
    from executor.campaign.engine import Engine, local_pool

    if options.ray is None:
        return local_pool
    from executor.campaign.ray_engine import RayEngine

    address = options.ray

    def cluster(worker: str, workers: int, limit_s: float) -> Engine:
        return RayEngine(address, worker, workers, limit_s, version=version, renders=renders)

    return cluster


def claim_wait_s() -> float:
    """Return how long to wait for another run of the same units [s]: a part that Slurm starts again does."""
    from executor.campaign.slurm import CLAIM_WAIT_S, RESTARTS

    return CLAIM_WAIT_S if os.environ.get(RESTARTS) else 0.0


def typed_words(command: str, options: EngineOptions, positional: str) -> list[str]:
    """Return the words of the command line of a part of an array job, without those that Slurm gives."""
    from executor.cli.execution import option_words

    words = [sys.executable, "-m", "executor", *command.split()]
    return [*words, *option_words(options, positional, NOT_OF_A_PART)]


def write_array(options: EngineOptions, words: list[str], units: int, out: Path, workers: int) -> int:
    """Write the array job of a command; return the exit code.

    Args:
        options: The options, with `slurm`.
        words: The command line of the whole request.
        units: Number of units that are left.
        out: Folder for results, which the parts share.
        workers: Processes of a part.
    """
    from executor.campaign.slurm import ArrayJob, parts_for
    from executor.cli.execution import command_line
    from executor.system.files import write_text

    file, logs = Path(options.slurm or ""), out / "slurm"
    parts = min(options.parts or parts_for(units), max(units, 1))
    job = ArrayJob(words, file, Path.cwd(), logs, parts, workers, options.hours)
    logs.mkdir(parents=True, exist_ok=True)  # Slurm makes none.
    write_text(file, job.script())
    if options.json:
        print_json({"ok": True, "slurm": str(file), "parts": parts, "units": units, "out": str(out)})
        return DONE
    say(f"{'written':11} {file}: {pluralize(units, 'unit')} in {pluralize(parts, 'part')}", style="bold")
    say(f"{'next':11} sbatch {file}")
    say(f"{'later':11} {command_line('status', out)}")
    tell("note: the folder and this program have to be the same on all machines")
    return DONE
