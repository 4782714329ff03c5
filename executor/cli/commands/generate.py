"""`scene2demo generate`: demonstrations into a store of episodes, in worker processes, resumable.

Exit code 0 when something succeeded, now or before, 1 when nothing did or a sentence cannot be planned whatever the
seed, and 130 after Ctrl-C. A part (`--shard`) ends with 1 only when none of its episodes came to an end.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from bddl.errors import Scene2DemoError
from bddl.terminal import pluralize
from executor.cli.engines import EngineOptions
from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.options import (
    ALL_CHANNELS,
    READ_SCENE,
    Axis,
    CampaignModelOptions,
    Channel,
    Channels,
    Flag,
    FullSize,
    KeepSizes,
    Maybe,
    Plain,
    RepairScene,
    ResultsFolder,
    RobotName,
    View,
)
from executor.cli.output import ERR, Pace, bar, counting, first_line, print_json, say, tell

if TYPE_CHECKING:
    from executor.campaign.engine import Campaign, Shard
    from executor.campaign.planning_model import PlanningModel
    from executor.data.generation import EpisodeCallback, Goals, Limits, Tally
    from executor.data.store import EpisodeStore
    from executor.data.units import DemoSeries, DemoUnit


@dataclass(frozen=True)
class Options(EngineOptions):
    """Make demonstrations: a store of episodes, complete, replayable, and folded into the formats that trainers load.

    Goes on where an earlier run with the same folder ended. What is to be made may be said here or in a plan's file,
    which counts where both say it.
    """

    what: tyro.conf.Positional[
        Annotated[tuple[str, ...], tyro.conf.arg(metavar="T1..T6|QUERY|PLAN.yaml", help_behavior_hint="(required)")]
    ]
    """Families of the benchmark, a sentence (with --scene), or a YAML file that lists what to make."""
    out: ResultsFolder
    scene: Annotated[Maybe[str], READ_SCENE] = None
    """Name of a scene, or a scene's JSON file, that the sentence is about; t1 to t4: the kitchen that an episode's
    seed draws."""
    all_tasks: Annotated[Maybe[str], READ_SCENE] = None
    """Instead of families or a sentence: a scene, of which everything is made that can be done in it. Each wish is
    gone through by geometry first, and what is infeasible is listed and left out; `tasks` lists the wishes."""
    limit: Maybe[int] = None
    """With --all-tasks: most wishes, those of one kind and then another."""
    episodes: Maybe[int] = None
    """How many episodes of each to make, by default 20; those that fail are counted, and left out of data sets. With
    --successes it is the most that are tried, by default ten for each."""
    successes: Maybe[int] = None
    """How many successes of each are wanted; no episode is begun once they are there."""
    seed: int = 0
    """Seed of the first episode; the following ones count up."""
    workers: int = 2
    """How many processes, on each machine; one that crashes costs its episode only."""
    vary: Annotated[tuple[Axis, ...], tyro.conf.arg(metavar="AXIS...", help_behavior_hint="")] = ()
    """What varies too: the target's size and heading, surfaces, lights, cameras, physics."""
    distractors: int = 0
    """Most things added to a scene that the task has nothing to do with."""
    noise_m: float = 0.0
    """Noise in the commands of the hand [m]; recorded actions are without it."""
    views: Annotated[tuple[View, ...], tyro.conf.arg(metavar="VIEW...", help_behavior_hint="")] = ()
    """Cameras to draw: global, head, wrist; by default none."""
    size: tuple[int, int] = (128, 128)
    """Width and height of the pictures."""
    plain: Plain = False
    channels: Channels = ALL_CHANNELS
    """What of each camera is kept: rgb, which always is, depth, segmentation."""
    rate_hz: float = 10.0
    """Samples a second of simulated time."""
    failures: Flag = False
    """Keep the motion of failed episodes too."""
    evolve: Flag = False
    """Revise the flows that fail; failed attempts with their corrections are kept as well."""
    flows: Literal["planned", "paper"] = "planned"
    """The offline planner's flows, or the paper's initial flows of T1 to T4, numbers verbatim."""
    keep_sizes: KeepSizes = False
    full_size: FullSize = False
    robot: RobotName = None
    repair: RepairScene = None
    stances: int = 1
    """How many stances to plan wherever one is chosen, of which the one with the arm nearest to home is taken: then it
    follows from what is seen, and policies learn it more easily. 1 takes the one that the episode's seed gives."""
    limit_h: Maybe[float] = None
    """Hours after which to stop; episodes in flight are lost, and the same command goes on later."""
    limit_gb: Maybe[float] = None
    """Gigabytes that may be added before it stops."""
    limit_s: float = 900.0
    """Wall time that an episode may take before its process is ended."""
    shard: str = "1/1"
    """Which part of the episodes to make, such as 3/8; all parts may share a folder."""
    again: Flag = False
    """Make episodes once more whose process crashed, hung, or met a mistake of the program."""
    asked: CampaignModelOptions = field(default_factory=CampaignModelOptions)


_BYTES_PER_GB = 10**9
_FEASIBLE_S = 30.0  # CPU seconds for the question whether a wish is feasible.


def execute(options: Options) -> int:
    """Make the missing episodes; return the exit code."""
    from executor.campaign.engine import Campaign
    from executor.campaign.versions import outcome_version
    from executor.cli.engines import claim_wait_s, engine_of, typed_words, write_array
    from executor.cli.execution import read_shard
    from executor.cli.planning import budget_of, planned_by_model
    from executor.data.generation import WORKER
    from executor.data.store import EpisodeStore
    from executor.data.views import check_drawable
    from executor.data.work import check_plannable, starts_alike
    from executor.view.stores import StoreListing

    series, shard = _requested_series(options), read_shard(options.shard)
    model = planned_by_model(options.asked, options.workers, options.out)
    if model is not None:
        unlike = {"--repair": options.repair, "--flows paper": options.flows == "paper"}
        for name in (name for name, given in unlike.items() if given):
            raise BadOption("--model", options.asked.model, f"no {name}: that is for the offline planner's plans")
        series = tuple(_with_model(one, model) for one in series)
    counted = next((one for one in series if one.successes is not None), None)
    check(
        counted is None or (shard.of == 1 and options.slurm is None),
        "successes" if options.successes is None else "--successes",
        "" if counted is None else counted.successes,
        "no --shard and no --slurm: parts do not know of each other's successes",
    )
    if not series:
        problem = "nothing in the scene is feasible"
        if options.json:
            print_json({"ok": False, "exit_code": FAILED, "store": str(options.out), "problem": problem})
        tell(f"scene2demo: {problem}", style="red")
        return FAILED
    renders = any(one.first.recording.views for one in series)
    if renders:
        check_drawable()
    for one in series:
        first, quiet = one.first, options.json or one.first.repair is None
        with counting(f"{first.origin.label}: looking for a scene of the first episode that is feasible", quiet=quiet):
            check_plannable(first)
    alike = [one for one in series if starts_alike(one)]
    if not options.json:
        _warn_alike(alike)
    if options.slurm is not None:
        store = EpisodeStore(options.out)
        store.add_requests([one.to_json() for one in series])
        words = typed_words("generate", options, "what")
        return write_array(options, words, sum(one.episodes for one in series), options.out, options.workers)
    engine = engine_of(options, outcome_version, renders=renders)
    campaign = Campaign(
        EpisodeStore(options.out),
        WORKER,
        options.workers,
        options.limit_s,
        more=partial(budget_of, options.asked),
        engine=engine,
    )
    unvaried = {"unvaried": [one.first.origin.query for one in alike]}
    code = make_missing(
        campaign,
        series,
        _budget(options),
        shard=shard,
        again=options.again,
        more=unvaried,
        wait_s=claim_wait_s(),
        as_json=options.json,
    )
    # The index of `view`; a unit that cannot be read, or is being replaced, is for `dataset check`.
    with suppress(Scene2DemoError, OSError, ValueError, KeyError, TypeError):
        StoreListing(options.out).rows()
    return code


def _with_model(one: DemoSeries, model: PlanningModel) -> DemoSeries:
    """Return a series whose units a model plans."""
    try:
        return replace(one, first=replace(one.first, model=model))
    except ValueError as problem:
        raise BadOption("--model", model.name, str(problem)) from None


def make_missing(
    campaign: Campaign[DemoUnit],
    series: Sequence[DemoSeries],
    limits: Limits | None = None,
    *,
    shard: Shard | None = None,
    again: bool = False,
    more: Mapping[str, Any] = MappingProxyType({}),
    wait_s: float = 0.0,
    as_json: bool,
) -> int:
    """Make the units of a request that a store lacks, print the outcome, and return the exit code.

    Args:
        campaign: Worker processes, and the store.
        series: The request.
        limits: Limits of the run; by default none.
        shard: Part of the units; by default all.
        again: Whether to repeat units whose process crashed or hung.
        more: Further fields for `--json`.
        wait_s: How long to wait for another run of the same units [s].
        as_json: Whether the outcome is printed as JSON.
    """
    from executor.campaign.engine import WHOLE, claimed, is_done
    from executor.campaign.planning_model import used_in
    from executor.campaign.versions import outcome_version
    from executor.data.generation import NO_LIMITS, Goals, Tally, generate
    from executor.data.store import EpisodeStore

    store, version = EpisodeStore(campaign.store.path), outcome_version()
    store.add_requests([one.to_json() for one in series])
    jobs = [(unit, version) for one in series for unit in one.units()]
    goals, interrupted = Goals(series), False
    with claimed(store, jobs, shard or WHOLE, wait_s, again=again) as todo:
        tally = Tally()  # Its clock begins after the wait.
        made_now = frozenset(todo)
        for job in jobs:
            if job not in made_now and (there := store.read(*job)) is not None:
                tally.note(there.meta["ended"], (there.meta.get("failure") or {}).get("kind"))
                goals.note(job[0], there.meta["ended"])
        with _show_progress(tally, goals, len(jobs), len(todo), quiet=as_json) as on_progress:
            try:
                generate(campaign, todo, on_progress, tally, limits or NO_LIMITS, goals)
            except KeyboardInterrupt:
                interrupted = True
    done = None if shard is None or shard.of == 1 else is_done(store, jobs, shard)
    models = [one.first.model for one in series if one.first.model is not None]
    if models:
        more = {**more, "usage": used_in(store.path, models[0]).record()}
    return finished(store, tally, more, interrupted=interrupted, done=done, as_json=as_json)


def _warn_alike(series: Sequence[DemoSeries]) -> None:
    """Warn of series whose episodes all start alike, and how to vary them."""
    from executor.data.units import UNVARIED

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


def _requested_series(options: Options) -> tuple[DemoSeries, ...]:
    """Return the requested series, after refusing options that make no sense."""
    from executor.cli.engines import check_engine
    from executor.cli.execution import check_seed, check_unit_limit, check_workers
    from executor.data.generation import read_plan, series_of

    check(options.successes is None or options.successes >= 1, "--successes", options.successes, "at least 1")
    check_seed(options.seed, _attempts(options))
    check_engine(options, options.shard, options.out)
    check_workers(options.workers)
    check_unit_limit(options.limit_s)
    for name, limit in (("--limit-h", options.limit_h), ("--limit-gb", options.limit_gb)):
        check(limit is None or limit > 0.0, name, limit, "a number above 0")
        check(limit is None or options.slurm is None, name, limit, "no --slurm: each part would have the limit")
    plans = [word for word in options.what if word.endswith((".yaml", ".yml"))]
    if plans:
        check(len(options.what) == 1, "PLAN.yaml", plans[0], "nothing with it")
        check(options.scene is None, "--scene", options.scene, "none with a plan, which names its scenes itself")
        check(options.all_tasks is None, "--all-tasks", options.all_tasks, "none with a plan")
        check(options.limit is None, "--limit", options.limit, "none with a plan")
        usual = _request_fields(Options(what=(), out=options.out))
        return read_plan(
            Path(plans[0]),
            {name: value for name, value in _request_fields(options).items() if value != usual.get(name)},
        )
    check(options.limit is None or options.all_tasks is not None, "--limit", options.limit, "--all-tasks as well")
    check(options.limit is None or options.limit >= 1, "--limit", options.limit, "at least 1")
    check(
        bool(options.views) or not options.plain,
        "--plain",
        "is given",
        "--views with it, the pictures that it is about",
    )
    sources = [_source(options)] if options.all_tasks is None else list(_everything(options, options.all_tasks))
    return series_of({**_request_fields(options), "sources": sources}) if sources else ()


def _everything(options: Options, name: str) -> Iterator[dict[str, Any]]:
    """Yield a source for every feasible wish of a scene; the answers are kept next to the folder for the next run."""
    from executor.campaign.versions import scene_version
    from executor.cli.inputs import robot_asked_for
    from executor.rollouts.admitted import Answers, in_turn
    from executor.scenes.file import scene_for
    from executor.scenes.validation import require_valid
    from llm import tasks
    from oag.sizes import Sizing

    check(not options.what and options.scene is None, "--all-tasks", name, "no family, sentence or --scene with it")
    scene = scene_for("", name, robot=robot_asked_for(options.robot, full_size=options.full_size))
    require_valid(scene)
    version = scene_version(scene.robot.model.keeps_order)
    answers = Answers(options.out.with_name(f"{options.out.name}-tasks.jsonl"), scene, options.seed, version)
    counts: Counter[str] = Counter()
    for answer in answers.of(in_turn(tasks(scene, sizing=Sizing(None, options.keep_sizes))), _FEASIBLE_S):
        word = "feasible" if answer.feasible else answer.reason
        counts["feasible" if answer.feasible else "left out"] += 1
        if not options.json:
            tell(f"  {answer.found.sentence:50} {word}", style=None if answer.feasible else "yellow")
        if answer.feasible:
            yield {"query": answer.found.sentence, "scene": name}
        if counts["feasible"] == options.limit:
            break
    if not options.json:
        tell(f"  {counts['feasible']} wishes are feasible, {counts['left out']} are left out")


def _source(options: Options) -> dict[str, Any]:
    from executor.scenes.generators.families import FAMILIES

    if options.what and set(options.what) <= set(FAMILIES):
        check(options.scene is None, "--scene", options.scene, "none with families, which draw their own")
        return {"families": list(options.what)}
    words = " ".join(options.what)
    if words and options.scene is not None and not set(options.what) & set(FAMILIES):
        return {"query": words, "scene": options.scene}  # Without quotes a shell passes its words one by one.
    words = words or "is missing"
    raise BadOption("what to make", words, f"families ({', '.join(FAMILIES)}), a sentence and --scene, or a .yaml file")


def _request_fields(options: Options) -> dict[str, Any]:
    same = ("seed", "successes", "distractors", "noise_m", "rate_hz", "failures", "evolve", "flows")
    sizes, lists = ("keep_sizes", "full_size"), ("vary", "views", "size")
    wishes = {name: getattr(options, name) for name in (*same, *sizes, "stances", "repair", "plain")}
    wishes["robot"] = options.robot or ""
    if options.episodes is not None:
        wishes["episodes"] = options.episodes
    wishes |= {name: list(getattr(options, name)) for name in lists}
    return wishes | channels_of(options.channels)


def _attempts(options: Options) -> int:
    """Return how many episodes of each are tried."""
    from executor.data.generation import attempts_for

    if options.episodes is not None:
        return options.episodes
    return attempts_for(options.successes)


def channels_of(channels: Sequence[Channel]) -> dict[str, bool]:
    """Return which of depth and segmentation are drawn in addition to the colours."""
    check("rgb" in channels, "--channels", " ".join(channels) or "nothing", "rgb, with depth or segmentation with it")
    return {"depth": "depth" in channels, "segmentation": "segmentation" in channels}


def _budget(options: Options) -> Limits:
    from executor.data.generation import Limits

    return Limits(
        wall_s=None if options.limit_h is None else 3600.0 * options.limit_h,
        store_bytes=None if options.limit_gb is None else round(_BYTES_PER_GB * options.limit_gb),
    )


@contextmanager
def _show_progress(tally: Tally, goals: Goals, total: int, remaining: int, *, quiet: bool) -> Iterator[EpisodeCallback]:
    """Provide a callback for every unit's ending that shows it: on a terminal a bar with the yield, else lines."""
    if quiet:
        yield lambda unit, result: None
        return
    before, wanted = tally.endings.total(), goals.wanted
    if before:
        tell(f"  {before} of {pluralize(total, 'episode')} made already, {remaining} to make now")
    shows_bar = ERR.is_terminal and remaining > 0
    begin = goals.there if wanted else before
    pace = Pace(wanted or total, begin, quiet=shows_bar)
    with bar(describe_yield(tally), wanted or total, done=begin, quiet=not shows_bar) as show:

        def show_unit(unit: DemoUnit, result: Mapping[str, Any]) -> None:
            good = result["ended"] == "succeeded"
            words = "succeeded" if good else f"{result.get('kind')}: {first_line(result.get('message'))}"
            tried, there = tally.endings.total(), goals.there if wanted else tally.endings.total()
            if not (shows_bar and good):
                count = f"{there:{len(str(wanted or total))}} of {wanted or total}"
                count += f" successes, {tried} tried" if wanted else ""
                line = f"  {count}  {unit.name:24} {result['elapsed_s']:6.1f} s  {words}"
                tell(line, style="red" if shows_bar else None)
            show(there, f"{describe_yield(tally)}, {pace.text(there)}")
            pace.note(there)

        yield show_unit


def describe_yield(tally: Tally) -> str:
    """Return the success count with its confidence interval, in words."""
    return yield_text(tally.endings["succeeded"], tally.endings.total())


def yield_text(good: int, of: int) -> str:
    """Return how many of the episodes that were made succeeded, with the interval."""
    from executor.campaign.rate import Rate

    return Rate(good, of).counted("succeeded") if of else "nothing made yet"


def finished(
    store: EpisodeStore,
    tally: Tally,
    more: Mapping[str, Any] = MappingProxyType({}),
    *,
    interrupted: bool,
    done: bool | None = None,
    as_json: bool,
) -> int:
    """Print the outcome and return the exit code: 1 where something was to be made, and nothing succeeded.

    Args:
        store: The store.
        tally: Outcomes of the units.
        more: Further fields for `--json`.
        interrupted: Whether it ended early.
        done: Of a part: whether it did its work, which decides the code instead; None of a whole request.
        as_json: Whether it is printed as JSON.
    """
    from executor.campaign.planning_model import NO_REPLIES, OUT_OF_BUDGET, why_stopped
    from executor.cli.execution import command_line
    from llm import Usage

    tried = tally.endings.total() > 0 or tally.stopped_by in (OUT_OF_BUDGET, NO_REPLIES)
    failed = tried and not tally.endings["succeeded"] if done is None else not done
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
    if "usage" in more:
        say(f"{'model':11} {Usage(**more['usage']).summary()}")
    say(f"{'store':11} {store.path}; scene2demo view {store.path} shows each episode")
    if tally.endings["succeeded"] and not (interrupted or tally.stopped_by):
        say(f"{'next':11} {command_line('dataset audit', store.path)}")
    if interrupted or tally.stopped_by:
        words = "interrupted; finished episodes are kept, the same command goes on"
        tell(f"scene2demo: {words if interrupted else why_stopped(tally.stopped_by, 'episodes')}", style="yellow")
    return code
