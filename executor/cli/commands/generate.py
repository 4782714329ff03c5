"""`scene2demo generate`: demonstrations into a store of episodes, in worker processes, resumable.

Exit code 0 when something succeeded, now or before, 1 when nothing did or a sentence cannot be planned whatever the
seed, and 130 after Ctrl-C.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from bddl.terminal import pluralize
from executor.campaign.engine import WHOLE, Campaign, Job, Shard, claimed, pending
from executor.campaign.versions import outcome_version
from executor.cli.data_options import Channel, GenerateOptions
from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.execution import check_seed, check_unit_limit, check_workers, read_shard
from executor.cli.output import ERR, print_json, say, tell
from executor.data.generation import NO_LIMITS, WORKER, EpisodeCallback, Limits, Tally, generate, read_plan, series_of
from executor.data.store import EpisodeStore
from executor.data.units import UNVARIED, DemoSeries, DemoUnit
from executor.data.views import check_drawable
from executor.data.work import check_plannable, starts_alike
from executor.scenes.generators.families import FAMILIES
from oag import clopper_pearson

_BYTES_PER_GB = 10**9


def execute(options: GenerateOptions) -> int:
    """Make the missing episodes; return the exit code."""
    series, shard = _requested_series(options), read_shard(options.shard)
    if any(one.first.recording.views for one in series):
        check_drawable()
    for one in series:
        check_plannable(one.first)
    alike = [one for one in series if starts_alike(one)]
    if not options.json:
        _warn_alike(alike)
    store = EpisodeStore(options.out)
    campaign = Campaign(store, WORKER, options.workers, options.limit_s)
    unvaried = {"unvaried": [one.first.origin.query for one in alike]}
    missing = Missing(series, outcome_version(), shard, again=options.again)
    return make_missing(campaign, missing, _budget(options), unvaried, as_json=options.json)


@dataclass(frozen=True, slots=True)
class Missing:
    """Requested units that a store may not have yet.

    Attributes:
        series: The requested series.
        version: Version of the program.
        shard: Part of the units.
        again: Whether to repeat units whose process crashed or hung.
    """

    series: Sequence[DemoSeries]
    version: str
    shard: Shard = WHOLE
    again: bool = False


def make_missing(
    campaign: Campaign[DemoUnit],
    missing: Missing,
    limits: Limits = NO_LIMITS,
    more: Mapping[str, Any] = MappingProxyType({}),
    *,
    as_json: bool,
) -> int:
    """Make the missing units of a request, print the outcome, and return the exit code."""
    store, series, version = EpisodeStore(campaign.store.path), missing.series, missing.version
    store.add_requests([one.to_json() for one in series])
    jobs = [(unit, version) for one in series for unit in one.units()]
    todo = list(pending(store, jobs, missing.shard, again=missing.again))
    tally, interrupted = Tally(), False
    with (
        claimed(store, todo),
        show_progress(store, series, version, tally, todo, quiet=as_json) as on_progress,
    ):
        try:
            generate(campaign, todo, on_progress, tally, limits)
        except KeyboardInterrupt:
            interrupted = True
    return finished(store, tally, more, interrupted=interrupted, as_json=as_json)


def _warn_alike(series: Sequence[DemoSeries]) -> None:
    """Warn of series whose episodes all start alike, and how to vary them."""
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


def _requested_series(options: GenerateOptions) -> tuple[DemoSeries, ...]:
    """Return the requested series, after refusing options that make no sense.

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
        usual = _request_fields(GenerateOptions(what=(), out=options.out))
        return read_plan(
            Path(plans[0]), {name: value for name, value in _request_fields(options).items() if value != usual[name]}
        )
    return series_of({**_request_fields(options), "sources": [_source(options)]})


def _source(options: GenerateOptions) -> dict[str, Any]:
    if options.what and set(options.what) <= set(FAMILIES):
        check(options.scene is None, "--scene", options.scene, "none beside families, which draw their own")
        return {"families": list(options.what)}
    words = " ".join(options.what)
    if words and options.scene is not None and not set(options.what) & set(FAMILIES):
        return {"query": words, "scene": options.scene}  # Without quotes a shell passes its words one by one.
    words = words or "is missing"
    raise BadOption("what to make", words, f"families ({', '.join(FAMILIES)}), a sentence and --scene, or a .yaml file")


def _request_fields(options: GenerateOptions) -> dict[str, Any]:
    same = ("seed", "episodes", "distractors", "noise_m", "rate_hz", "failures", "evolve", "flows")
    sizes, lists = ("keep_sizes", "full_size"), ("vary", "views", "size")
    wishes = {name: getattr(options, name) for name in (*same, *sizes, "stances")}
    wishes |= {name: list(getattr(options, name)) for name in lists}
    return wishes | channels_of(options.channels)


def channels_of(channels: Sequence[Channel]) -> dict[str, bool]:
    """Return which of depth and segmentation are drawn in addition to the colours.

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
def show_progress(
    store: EpisodeStore,
    series: Sequence[DemoSeries],
    version: str,
    tally: Tally,
    todo: Collection[Job[DemoUnit]],
    *,
    quiet: bool,
) -> Iterator[EpisodeCallback]:
    """Provide a callback for every unit's ending that shows it: on a terminal a bar with the yield, else lines.

    Args:
        store: Where episodes are kept; finished ones count, where they are not made again.
        series: The requested series.
        version: Hash of the program.
        tally: Counts the finished units.
        todo: What is still to be made here.
        quiet: Shows nothing.
    """
    before, remaining, made_now = 0, len(todo), frozenset(unit for unit, _ in todo)
    for unit in (unit for one in series for unit in one.units()):
        if unit not in made_now and (done := store.read(unit, version)) is not None:
            tally.note(done.meta["ended"], (done.meta.get("failure") or {}).get("kind"))
            before += 1
    if quiet:
        yield lambda unit, result: None
        return
    total = sum(one.episodes for one in series)
    if before:
        tell(f"  {before} of {pluralize(total, 'episode')} made already, {remaining} to make now")
    shows_bar = ERR.is_terminal and remaining > 0
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=ERR, disable=not shows_bar) as bar:
        task = bar.add_task(describe_yield(tally), total=total, completed=before)

        def show_unit(unit: DemoUnit, result: Mapping[str, Any]) -> None:
            good = result["ended"] == "succeeded"
            words = "succeeded" if good else f"{result.get('kind')}: {result.get('message')}"
            if not (shows_bar and good):
                count = f"{tally.endings.total():{len(str(total))}} of {total}"
                line = f"  {count}  {unit.name:24} {result['elapsed_s']:6.1f} s  {words}"
                tell(line, style="red" if shows_bar else None)
            bar.update(task, advance=1, description=f"{describe_yield(tally)}, {tally.kept_an_hour:.0f} an hour")

        yield show_unit


def describe_yield(tally: Tally) -> str:
    """Return the success count with its confidence interval, in words."""
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
    """Print the outcome and return the exit code: 1 where something was to be made, and nothing succeeded.

    Args:
        store: The store.
        tally: Outcomes of the units.
        more: Further fields for `--json`.
        interrupted: Whether it ended early.
        as_json: Whether it is printed as JSON.
    """
    failed = tally.endings.total() > 0 and not tally.endings["succeeded"]
    code = INTERRUPTED if interrupted else FAILED if failed else DONE
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
    say(f"{'yield':11} {describe_yield(tally)}", style="bold")
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
