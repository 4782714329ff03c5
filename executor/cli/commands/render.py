"""`scene2demo dataset render`: draw a store's pictures again, from its states, in worker processes, resumable."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bddl.terminal import pluralize
from executor.campaign.engine import claimed
from executor.cli.commands.generate import channels_of
from executor.cli.data_options import RenderOptions
from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.execution import check_unit_limit, check_workers
from executor.cli.output import counting, print_json, say, tell
from executor.data.rerender import RerenderSettings, plan_rerender, rerender
from executor.data.store import EpisodeStore
from executor.data.units import DemoUnit
from executor.data.views import check_drawable
from executor.scenes.vary import LARGEST_SEED
from executor.sim.render.frames import check_size


def execute(options: RenderOptions) -> int:
    """Draw the missing episodes; return the exit code."""
    wanted = _wanted(options)
    source, out = EpisodeStore.open(options.store), EpisodeStore(options.out)
    if options.out.resolve() == options.store.resolve():
        raise BadOption("--out", options.out, "another folder than the store that is drawn")
    check_drawable()
    left = plan_rerender(source, out, wanted)
    broken: list[str] = []
    drawn, interrupted = 0, False
    jobs = [(unit, str(episode.meta["version"])) for episode, unit in left]
    with claimed(out, jobs), counting("drawing episodes", quiet=options.json) as progress:

        def show_unit(unit: DemoUnit, result: Mapping[str, Any]) -> None:
            nonlocal drawn
            if result["ended"] == "drawn":
                drawn += 1
                progress(drawn, len(left))
                return
            broken.append(unit.name)
            if not options.json:
                tell(f"  {unit.name:24} {result['message']}", style="red")

        try:
            rerender(out, left, options.workers, show_unit, limit_s=options.limit_s)
        except KeyboardInterrupt:
            interrupted = True
    code = INTERRUPTED if interrupted else FAILED if broken else DONE
    if options.json:
        print_json({"ok": code == DONE, "exit_code": code, "store": str(out.path), "drawn": drawn, "broken": broken})
        return code
    words = f", {len(broken)} not: the same command tries them again" if broken else ""
    say(f"{'drawn now':11} {pluralize(drawn, 'episode')}{words}", style="bold")
    say(f"{'store':11} {out.path}")
    if interrupted:
        tell("scene2demo: interrupted; finished episodes are kept, the same command goes on", style="yellow")
    return code


def _wanted(options: RenderOptions) -> RerenderSettings:
    check_workers(options.workers)
    check_unit_limit(options.limit_s)
    check(len(options.views) > 0, "--views", "nothing", "one of global, head, wrist, or several")
    check(len(set(options.views)) == len(options.views), "--views", " ".join(options.views), "each view once")
    check(0 <= options.seed <= LARGEST_SEED, "--seed", options.seed, f"a number from 0 to {LARGEST_SEED}")
    return RerenderSettings(
        views=options.views,
        size=check_size(options.size),
        **channels_of(options.channels),
        vary=options.vary,
        look=options.seed,
    )
