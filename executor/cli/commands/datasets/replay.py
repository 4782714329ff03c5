"""`scene2demo replay`: demonstrations once more, exactly or through the environment, and how many come out.

The exit code is 0 when every exact repetition gave the same states, and 1 when one did not. How often actions succeed
again through the environment is a measurement: 0 whatever comes of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

from executor.cli.errors import DONE, FAILED, BadOption, check
from executor.cli.output import print_json, say, tell
from executor.cli.words.datasets import ReplayOptions
from executor.datasets.formats.export import open_set
from executor.datasets.formats.stream import DEMONSTRATION
from executor.datasets.store import INDEX, EpisodeStore, NotADataset
from executor.envs.replay import Redone, Way, replayed, replayed_rows
from oag import clopper_pearson


def execute(options: ReplayOptions) -> int:
    """Does demonstrations again; returns the exit code."""
    check(options.episodes is None or options.episodes > 0, "--episodes", options.episodes, "a number above 0")
    exact = options.through == "log"
    check(not exact or options.actions == "joint_target", "--actions", options.actions, "--through env beside it")
    way: Way = "exact" if exact else options.actions
    found: list[Redone] = []
    for one in islice(_redone(options, way), options.episodes):
        found.append(one)
        if not (options.json or one.good):
            tell(f"  {one.name}: {_wrong(exact, one)}", style="red")
    if not found:
        raise NotADataset(f"{options.store} has no demonstration whose motion was kept: nothing can be done again")
    good = sum(one.good for one in found)
    low, high = clopper_pearson(good, len(found))
    code = FAILED if exact and good < len(found) else DONE
    if options.json:
        failed = [one.name for one in found if not one.good]
        numbers = {"way": way, "replayed": len(found), "good": good, "interval": [low, high], "failed": failed}
        print_json({"ok": code == DONE, "exit_code": code, **numbers})
        return code
    what = "gave the same states" if exact else f"succeeded again through the environment, by {_WORDS[way]}"
    words = f"{good} of {len(found)} {what} ({100 * low:.1f} to {100 * high:.1f} %)"
    say(f"{'replayed':11} {words}", style="bold" if good == len(found) else "yellow")
    return code


def _redone(options: ReplayOptions, way: Way) -> Iterator[Redone]:
    """Yields what comes of each demonstration of a store, or of what was exported of one."""
    if (options.store / INDEX).exists() or not options.store.is_dir():
        yield from (replayed(episode, way) for episode in EpisodeStore.open(options.store).demonstrations())
        return
    stream = open_set(options.store)
    if way == "exact":
        raise BadOption("--through", "log", "env for a data set that was exported: it has actions, and no commands")
    for episode in stream.episodes():
        if episode.about["kind"] == DEMONSTRATION:
            yield replayed_rows(episode, stream.found.rate_hz, way)


_WORDS = {"joint_target": "joint targets", "paper": "the paper's hand actions"}


def _wrong(exact: bool, replay: Redone) -> str:
    return "other states" if exact else f"no success; it came {100 * replay.progress:.0f} % of the way"
