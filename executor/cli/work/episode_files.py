"""The folders of `rollout --out`: one an episode, with the plan, the record, the report and the dataset."""

from __future__ import annotations

import shlex

from executor.cli.options.running import Rollout as RolloutOptions
from executor.cli.terminal.output import tell
from executor.machine.extras import MissingExtra, require
from executor.records.rollout import Rollout
from executor.results.run_folder import episode_folders
from executor.results.run_record import RunRecord
from oag import ObjectActionGraph, Report


class EpisodeKeeper:
    """Writes what episodes leave behind, each into its folder; nothing where no folder was asked for.

    Args:
        graph: The composed task.
        report: What `verify` decided.
        options: The command's options.
        force: Whether results that a folder already has are replaced.

    Raises:
        ResultsExist, FolderUnusable: A folder cannot take the results; found before the first episode runs.
    """

    def __init__(self, graph: ObjectActionGraph, report: Report, options: RolloutOptions, *, force: bool) -> None:
        self._graph, self._report, self._options = graph, report, options
        seeds = range(options.seed, options.seed + options.episodes)
        self._folders = episode_folders(options.out, seeds, force=force)
        self._dataset = options.out is not None and _can_write_datasets()

    def keep(self, done: Rollout, interrupted: bool) -> None:
        """Writes one episode's files."""
        if done.seed not in self._folders:
            return
        folder = self._folders[done.seed]
        command = command_line(self._options, done.seed)
        record = RunRecord(self._graph, self._report, rollout=done, interrupted=interrupted, command=command)
        with folder.filling():
            folder.write_plan(record)
            folder.write_rollout(done)
            folder.write_report(record, None)
            if self._dataset:
                folder.write_episode(done, None)


def command_line(options: RolloutOptions, seed: int) -> str:
    """Returns the command line that repeats one episode."""
    words = ["scene2demo", "rollout", str(options.task), "--scene", options.scene, "--seed", str(seed)]
    if options.open_numbers:
        words.append("--open-numbers")
    if options.out is not None:
        words += ["--out", str(options.out)]
    return shlex.join(words)


def _can_write_datasets() -> bool:
    """Decides whether episodes become datasets; says so once when they cannot, and everything else is written."""
    try:
        require("h5py", "data")
    except MissingExtra as missing:
        tell(f"no dataset: {missing}", style="yellow")
        return False
    return True
