"""`scene2demo replay`: repeat demonstrations, exactly or through the environment, and count the successes.

The exit code is 0 when every exact repetition gave the same states, and 1 when one did not. How often actions succeed
again through the environment is a measurement: 0 whatever the outcome.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.options import CommonOptions, Maybe, Read
from executor.cli.output import bar, print_json, say, tell

if TYPE_CHECKING:
    from executor.envs.demonstration_replay import ReplayMode, ReplayOutcome
    from executor.system.workers import WorkerOutcome


@dataclass(frozen=True)
class Options(CommonOptions):
    """Do demonstrations again, and count how many come out as they were.

    By default the recorded commands are repeated, and the states have to be the same bit by bit; the exit code is 1
    when those of one are not. What was exported has no log of commands, but actions: `--through env`.
    (`scene2demo bench replay` runs one unit of a benchmark again, and shows it.)
    """

    store: tyro.conf.Positional[Annotated[Path, Read()]]
    """A store of episodes, as `generate` makes them, or a data set that was exported of one."""
    through: Literal["log", "env"] = "log"
    """log: by the command log, exactly; env: by actions, through the Gymnasium environment, at the samples' rate."""
    actions: Literal["joint_target", "paper"] = "joint_target"
    """With --through env: what the actions are, absolute joint targets or the paper's ten numbers."""
    episodes: Maybe[int] = None
    """How many to do again, from the first on; by default all."""
    only: Annotated[str, tyro.conf.arg(metavar="KEY=VALUE,...", help_behavior_hint="(default: all)")] = ""
    """Which of a store's, such as seed=3+5 or episode=NAME, as `dataset export` takes them."""
    workers: int = 1
    """How many processes; one does them in this process."""


def execute(options: Options) -> int:
    """Repeat demonstrations; return the exit code."""
    from executor.cli.execution import check_workers
    from executor.data.formats.selection import Selection
    from executor.data.store import NotADataset
    from executor.envs.demonstration_replay import count_demonstrations, is_store

    check(options.episodes is None or options.episodes > 0, "--episodes", options.episodes, "a number above 0")
    check_workers(options.workers)
    exact = options.through == "log"
    check(not exact or options.actions == "joint_target", "--actions", options.actions, "--through env with it")
    if exact and not is_store(options.store):
        raise BadOption("--through", "log", "env for a data set that was exported: it has actions, and no commands")
    only = Selection.parse(options.only)
    if only.chosen and not is_store(options.store):
        raise BadOption("--only", options.only, "a store: what was exported has no such keys")
    total = count_demonstrations(options.store, options.episodes, only)
    if not total:
        chosen = f" that is chosen by --only {only.text}" if only.chosen else ""
        raise NotADataset(
            f"{options.store} has no demonstration{chosen} whose motion was kept: nothing can be done again"
        )
    found: list[ReplayOutcome] = []
    interrupted = False
    with bar("doing again", total, quiet=options.json) as show:
        try:
            with closing(_redone(options, "exact" if exact else options.actions, total)) as redone:
                for one in redone:
                    found.append(one)
                    show(len(found), f"{sum(each.good for each in found)} good")
                    if not (options.json or one.good):
                        tell(f"  {one.name}: {_wrong(exact, one)}", style="red")
        except KeyboardInterrupt:
            interrupted = True
    return _finished(options, found, exact=exact, interrupted=interrupted)


def _finished(options: Options, found: list[ReplayOutcome], *, exact: bool, interrupted: bool) -> int:
    from executor.campaign.rate import Rate

    good = sum(one.good for one in found)
    rate = Rate(good, len(found))
    low, high = (percent / 100.0 for percent in rate.interval_percent or (0.0, 100.0))
    code = INTERRUPTED if interrupted else FAILED if exact and good < len(found) else DONE
    if options.json:
        failed = sorted(one.name for one in found if not one.good)
        numbers = {"replayed": len(found), "good": good, "interval": [low, high], "failed": failed}
        mode = "exact" if exact else options.actions
        print_json({"ok": code == DONE, "exit_code": code, "way": mode, **numbers})
        return code
    what = "gave the same states" if exact else f"succeeded again through the environment, by {_WORDS[options.actions]}"
    words = rate.counted(what)
    say(f"{'replayed':11} {words}", style="bold" if good == len(found) else "yellow")
    if interrupted:
        tell("scene2demo: interrupted", style="yellow")
    return code


def _redone(options: Options, mode: ReplayMode, total: int) -> Generator[ReplayOutcome, None, None]:
    """Yield the outcome of each demonstration, as they end."""
    from executor.data.formats.selection import Selection
    from executor.envs.demonstration_replay import WORKER, iterate_replays
    from executor.system.workers import WorkerPool

    if options.workers == 1:
        yield from (
            redo() for redo in islice(iterate_replays(options.store, mode, Selection.parse(options.only)), total)
        )
        return
    asked = [
        {"set": str(options.store.absolute()), "way": mode, "only": options.only, "place": place}
        for place in range(total)
    ]
    pool = WorkerPool(WORKER, min(options.workers, total), environment={"OMP_NUM_THREADS": "1"})
    with closing(pool.run(asked)) as outcomes:
        for outcome in outcomes:
            yield _check_outcome(outcome)


def _check_outcome(outcome: WorkerOutcome) -> ReplayOutcome:
    from executor.data.store import NotADataset
    from executor.envs.demonstration_replay import ReplayOutcome

    if outcome.ending == "finished":
        return ReplayOutcome(**outcome.answer)
    if outcome.ending == "error" and outcome.answer.get("kind") == NotADataset.__name__:
        raise NotADataset(str(outcome.answer.get("error", outcome.message)))
    return ReplayOutcome(f"demonstration {outcome.request['place'] + 1}", False, 0.0, outcome.message)


_WORDS = {"joint_target": "joint targets", "paper": "the paper's hand actions"}


def _wrong(exact: bool, replay: ReplayOutcome) -> str:
    if replay.problem:
        return replay.problem
    return "other states" if exact else f"no success; it came {100 * replay.progress:.0f} % of the way"
