"""A process that runs episodes of `rollout --workers`, one after the other; started by its module's name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from executor.cli.options.running import Rollout
from executor.cli.terminal.progress import RolloutProgress
from executor.cli.work.episode_files import EpisodeKeeper
from executor.cli.work.episodes import graph_of, run_here
from executor.machine.files import plain
from executor.machine.workers.process import serve


def _handle(request: dict[str, Any]) -> dict[str, Any]:
    out = None if request["out"] is None else Path(request["out"])
    options = Rollout(
        Path(request["task"]), request["scene"], seed=request["seed"], open_numbers=request["open_numbers"], out=out
    )
    graph = graph_of(options)
    # The parent has made the folder already, and knows that its results may be replaced.
    keeper = EpisodeKeeper(graph, graph.verify(), options, force=True)
    (result,) = run_here(graph, options, keeper.keep, RolloutProgress(quiet=True))
    answer: dict[str, Any] = plain(result.to_json())
    return answer


if __name__ == "__main__":
    serve(_handle)
