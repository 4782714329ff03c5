"""`scene2demo dataset render`: a store's pictures drawn anew, from its states, in worker processes, resumable."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bddl.visible import counted
from executor.bench.presence import at_work
from executor.cli.commands.datasets.generate import channels_of
from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.executing import check_workers
from executor.cli.output import counting, print_json, say, tell
from executor.cli.sharing import check_unit_limit
from executor.cli.words.datasets import RenderOptions
from executor.datasets.footage import check_drawable
from executor.datasets.store import EpisodeStore
from executor.datasets.units import DemoUnit
from executor.datasets.upkeep.redraw import Redrawing, asked_for, redraw
from executor.pictures.render import check_size
from executor.scenes.vary import LARGEST_SEED


def execute(options: RenderOptions) -> int:
    """Draws what is not there yet; returns the exit code."""
    wanted = _wanted(options)
    source, out = EpisodeStore.open(options.store), EpisodeStore(options.out)
    if options.out.resolve() == options.store.resolve():
        raise BadOption("--out", options.out, "another folder than the store that is drawn")
    check_drawable()
    left = asked_for(source, out, wanted)
    broken: list[str] = []
    drawn, interrupted = 0, False
    ids = [unit.id(str(episode.meta["version"])) for episode, unit in left]
    with at_work(out.path, ids), counting("drawing episodes", quiet=options.json) as progress:

        def told(unit: DemoUnit, result: Mapping[str, Any]) -> None:
            nonlocal drawn
            if result["ended"] == "drawn":
                drawn += 1
                progress(drawn, len(left))
                return
            broken.append(unit.name)
            if not options.json:
                tell(f"  {unit.name:24} {result['message']}", style="red")

        try:
            redraw(out, left, options.workers, told, limit_s=options.limit_s)
        except KeyboardInterrupt:
            interrupted = True
    code = INTERRUPTED if interrupted else FAILED if broken else DONE
    if options.json:
        print_json({"ok": code == DONE, "exit_code": code, "store": str(out.path), "drawn": drawn, "broken": broken})
        return code
    words = f", {len(broken)} not: the same command tries them again" if broken else ""
    say(f"{'drawn now':11} {counted(drawn, 'episode')}{words}", style="bold")
    say(f"{'store':11} {out.path}")
    if interrupted:
        tell("scene2demo: interrupted; finished episodes are kept, the same command goes on", style="yellow")
    return code


def _wanted(options: RenderOptions) -> Redrawing:
    check_workers(options.workers)
    check_unit_limit(options.limit_s)
    check(len(options.views) > 0, "--views", "nothing", "one of global, head, wrist, or several")
    check(len(set(options.views)) == len(options.views), "--views", " ".join(options.views), "each view once")
    check(0 <= options.seed <= LARGEST_SEED, "--seed", options.seed, f"a number from 0 to {LARGEST_SEED}")
    return Redrawing(
        views=options.views,
        size=check_size(options.size),
        **channels_of(options.channels),
        vary=options.vary,
        look=options.seed,
    )
