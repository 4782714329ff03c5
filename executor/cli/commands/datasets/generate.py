"""`scene2demo generate`: demonstrations into a store of episodes, in worker processes, resumable.

Returns 0 when something succeeded, now or before, 1 when nothing did or a sentence cannot be planned whatever the seed,
and 130 after Ctrl-C.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from bddl.visible import counted
from executor.bench.presence import at_work
from executor.bench.units import FAMILIES, outcome_version
from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.executing import check_seed, check_workers
from executor.cli.output import ERR, print_json, say, tell
from executor.cli.sharing import check_unit_limit, read_shard
from executor.cli.words.datasets import Channel, GenerateOptions
from executor.datasets.footage import check_drawable
from executor.datasets.generate import WORKER, Limits, Tally, Told, generate
from executor.datasets.plan import read_plan, series_of
from executor.datasets.store import EpisodeStore, pending
from executor.datasets.units import DemoSeries, DemoUnit
from executor.datasets.variation import UNVARIED
from executor.datasets.work import check_plannable, start_alike
from oag import clopper_pearson

_BYTES_PER_GB = 10**9


def execute(options: GenerateOptions) -> int:
    """Makes what is not there yet; returns the exit code."""
    series, shard = _asked(options), read_shard(options.shard)
    if any(one.first.recording.views for one in series):
        check_drawable()
    for one in series:
        check_plannable(one.first)
    alike = [one for one in series if start_alike(one)]
    if not options.json:
        _tell_alike(alike)
    store, version = EpisodeStore(options.out), outcome_version()
    store.add_requests([one.to_json() for one in series])
    todo = list(pending(store, series, version, shard, again=options.again))
    tally, interrupted = Tally(), False
    with (
        at_work(store.path, [unit.id(version) for unit in todo]),
        shown_progress(store, series, version, tally, todo, quiet=options.json) as told,
    ):
        try:
            limits, limit_s = _budget(options), options.limit_s
            generate(
                store, todo, version, options.workers, told, tally=tally, limits=limits, limit_s=limit_s, worker=WORKER
            )
        except KeyboardInterrupt:
            interrupted = True
    unvaried = {"unvaried": [one.first.origin.query for one in alike]}
    return finished(store, tally, unvaried, interrupted=interrupted, as_json=options.json)


def _tell_alike(series: Sequence[DemoSeries]) -> None:
    """Say of which series all episodes will start alike, and how they would not."""
    for one in series:
        unseen = (
            "" if one.first.variation == UNVARIED else ", and --vary shows in pictures only, of which there are none"
        )
        tell(
            f"  {one.first.origin.label}: nothing will vary but the planner's choices. All {one.episodes} episodes "
            f"start alike: the scene has no `variation` block that makes them differ{unseen}. Give it one, or --vary "
            "with what is to vary (docs/datasets.md, What varies)",
            style="yellow",
        )


def _asked(options: GenerateOptions) -> tuple[DemoSeries, ...]:
    """Returns the series that were asked for, after refusing options that make no sense.

    Raises:
        BadOption, PlanError, SceneError, SceneNotFound: They do not, or nothing can be made of them.
    """
    check_seed(options.seed, options.episodes)
    check_workers(options.workers)
    check_unit_limit(options.limit_s)
    for name, limit in (("--limit-h", options.limit_h), ("--limit-gb", options.limit_gb)):
        check(limit is None or limit > 0.0, name, limit, "a number above 0")
    plans = [word for word in options.what if word.endswith((".yaml", ".yml"))]
    if plans:
        check(len(options.what) == 1, "PLAN.yaml", plans[0], "nothing beside it")
        check(options.scene is None, "--scene", options.scene, "none beside a plan, which names its scenes itself")
        usual = _wishes(GenerateOptions(what=(), out=options.out))
        return read_plan(Path(plans[0]), {name: said for name, said in _wishes(options).items() if said != usual[name]})
    return series_of({**_wishes(options), "sources": [_source(options)]})


def _source(options: GenerateOptions) -> dict[str, Any]:
    if options.what and set(options.what) <= set(FAMILIES):
        check(options.scene is None, "--scene", options.scene, "none beside families, which draw their own")
        return {"families": list(options.what)}
    words = " ".join(options.what)
    if words and options.scene is not None and not set(options.what) & set(FAMILIES):
        return {"query": words, "scene": options.scene}  # Without quotes a shell passes its words one by one.
    words = words or "is missing"
    raise BadOption("what to make", words, f"families ({', '.join(FAMILIES)}), a sentence and --scene, or a .yaml file")


def _wishes(options: GenerateOptions) -> dict[str, Any]:
    same = ("seed", "episodes", "distractors", "noise_m", "rate_hz", "failures", "evolve", "flows")
    sizes, lists = ("keep_sizes", "full_size"), ("vary", "views", "size")
    wishes = {name: getattr(options, name) for name in (*same, *sizes, "stances")}
    wishes |= {name: list(getattr(options, name)) for name in lists}
    return wishes | channels_of(options.channels)


def channels_of(channels: Sequence[Channel]) -> dict[str, bool]:
    """Returns which of depth and segmentation are drawn beside the colours.

    Raises:
        BadOption: Colours are left out.
    """
    check("rgb" in channels, "--channels", " ".join(channels) or "nothing", "rgb, with depth or segmentation beside it")
    return {"depth": "depth" in channels, "segmentation": "segmentation" in channels}


def _budget(options: GenerateOptions) -> Limits:
    return Limits(
        wall_s=None if options.limit_h is None else 3600.0 * options.limit_h,
        store_bytes=None if options.limit_gb is None else round(_BYTES_PER_GB * options.limit_gb),
    )


@contextmanager
def shown_progress(
    store: EpisodeStore,
    series: Sequence[DemoSeries],
    version: str,
    tally: Tally,
    todo: Collection[DemoUnit],
    *,
    quiet: bool,
) -> Iterator[Told]:
    """Gives what is told every unit's ending, and shows it: on a terminal a bar with the yield, else lines.

    Args:
        store: Where episodes are kept; what is there already counts, where it is not made again.
        series: What was asked for.
        version: Hash of the program.
        tally: Counts what is made.
        todo: What is still to be made here.
        quiet: Shows nothing.
    """
    before, remaining, made_now = 0, len(todo), frozenset(todo)
    for unit in (unit for one in series for unit in one.units()):
        if unit not in made_now and (done := store.read(unit, version)) is not None:
            tally.note(done.meta["ended"], (done.meta.get("failure") or {}).get("kind"))
            before += 1
    if quiet:
        yield lambda unit, result: None
        return
    total = sum(one.episodes for one in series)
    if before:
        tell(f"  {before} of {counted(total, 'episode')} made already, {remaining} to make now")
    shows_bar = ERR.is_terminal and remaining > 0
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=ERR, disable=not shows_bar) as bar:
        task = bar.add_task(yield_words(tally), total=total, completed=before)

        def told(unit: DemoUnit, result: Mapping[str, Any]) -> None:
            good = result["ended"] == "succeeded"
            words = "succeeded" if good else f"{result.get('kind')}: {result.get('message')}"
            if not (shows_bar and good):
                count = f"{tally.endings.total():{len(str(total))}} of {total}"
                line = f"  {count}  {unit.name:24} {result['elapsed_s']:6.1f} s  {words}"
                tell(line, style="red" if shows_bar else None)
            bar.update(task, advance=1, description=f"{yield_words(tally)}, {tally.kept_an_hour:.0f} an hour")

        yield told


def yield_words(tally: Tally) -> str:
    """Returns how many succeeded, and in what range the true share lies, in words."""
    good, of = tally.endings["succeeded"], tally.endings.total()
    if not of:
        return "nothing made yet"
    low, high = clopper_pearson(good, of)
    return f"{good} of {of} succeeded ({100 * low:.1f} to {100 * high:.1f} %)"


def finished(
    store: EpisodeStore,
    tally: Tally,
    more: Mapping[str, Any] = MappingProxyType({}),
    *,
    interrupted: bool,
    as_json: bool,
) -> int:
    """Says what came of it and returns the exit code: 1 where something was to be made, and nothing succeeded.

    Args:
        store: Where it is.
        tally: What came of the units.
        more: What else `--json` prints.
        interrupted: Whether it ended early.
        as_json: Whether it is printed as JSON.
    """
    needed = tally.endings.total() - tally.kinds["not-needed"]
    code = INTERRUPTED if interrupted else FAILED if needed and not tally.endings["succeeded"] else DONE
    each = max(tally.kept, 1)
    numbers = {
        "made": tally.made,
        "kept": tally.kept,
        "kept_an_hour": round(tally.kept_an_hour),
        "core_s_each": round(tally.cpu_s / each, 2),
        "bytes_each": round(tally.added_bytes / each),
    }
    if as_json:
        endings = {"endings": dict(tally.endings), "failures": dict(tally.kinds), "stopped_by": tally.stopped_by}
        print_json({"ok": code == DONE, "exit_code": code, "store": str(store.path), **numbers, **endings, **more})
        return code
    say(f"{'yield':11} {yield_words(tally)}", style="bold")
    if tally.kept:
        cost = f"{numbers['core_s_each']:.1f} core-seconds and {numbers['bytes_each'] / 1000:.0f} kB each"
        say(f"{'made now':11} {tally.made}, {numbers['kept_an_hour']} demonstrations an hour, {cost}")
    for kind, count in tally.kinds.most_common():
        say(f"{'failed':11} {count} x {kind}")
    say(f"{'store':11} {store.path}")
    if interrupted or tally.stopped_by:
        why = "interrupted" if interrupted else f"stopped: {tally.stopped_by} is used up"
        tell(f"scene2demo: {why}; finished episodes are kept, the same command goes on", style="yellow")
    return code
