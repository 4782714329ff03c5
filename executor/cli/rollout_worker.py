"""A process that runs episodes of `rollout --workers`, one after the other: `python -m executor.cli.rollout_worker`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from executor.cli.episode_files import EpisodeKeeper
from executor.cli.episodes import graph_of, run_here
from executor.cli.progress import RolloutProgress
from executor.cli.running_options import Rollout
from executor.files import plain
from executor.workers.serving import serve


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
