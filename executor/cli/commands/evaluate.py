"""`scene2demo evaluate`: run policies in the environment, all in the same episodes, and count the outcomes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields
from functools import partial
from itertools import count as counter
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Annotated, Any
from urllib.parse import quote

import tyro

from bddl.files import read_bounded_text
from executor.cli.engines import EngineOptions
from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.options import Family, Flag, Maybe, Read
from executor.cli.output import Pace, bar, print_json, say, tell
from executor.system.files import write_json, write_text

if TYPE_CHECKING:
    from executor.learn.acting import LeRobotPolicy, Policy
    from executor.learn.demonstrations import EpisodeKind
    from executor.learn.evaluation import EpisodeOutcome, EpisodeStates
    from executor.learn.policy_record import PolicyRecord
    from executor.learn.scores import Curve, EvaluationReport, PolicyScore


@dataclass(frozen=True)
class Options(EngineOptions):
    """Have policies act in the environment, all of them in the same episodes, and count what comes of it."""

    policies: tyro.conf.Positional[
        Annotated[
            tuple[Path, ...],
            tyro.conf.arg(
                metavar="POLICY...",
                help="Folders that `train` filled, or policies of LeRobot (its `pretrained_model`).",
                help_behavior_hint="(required)",
            ),
            Read(),
        ]
    ]
    task: Maybe[Family] = None
    """A family of the benchmark; by default what the policies were trained on."""
    data: Maybe[Path] = None
    """The data set that policies of LeRobot were trained on, or its store; ours say it themselves."""
    episodes: int = 50
    """How many episodes; with --until the most."""
    until: Maybe[float] = None
    """Width in percentage points of the 95 % intervals of all success rates at which no further episode is begun, such
    as 14; from the tenth on."""
    seed: int = 0
    """Seed of the first episode, one that no demonstration has; the following ones count up."""
    execute: Maybe[int] = None
    """How many actions of a chunk are done before a policy looks again; by default what its settings say."""
    steps: Annotated[tuple[int, ...], tyro.conf.arg(metavar="STEP...", help_behavior_hint="")] = ()
    """The weights after so many steps of training, where they were kept, each as a policy; by default the last."""
    out: Maybe[Path] = None
    """Folder for results: evaluation.json and evaluation.html, and with --videos the videos."""
    videos: Flag = False
    """Draw a video of every failure."""
    size: tuple[int, int] = (320, 240)
    """Width and height of the videos."""
    threads: int = 1
    """How many threads a network has."""
    workers: int = 1
    """How many processes, on each machine; one acts in this process."""
    shard: str = "1/1"
    """Which part of the episodes to run, such as 3/8; all parts may share a folder."""
    again: Flag = False
    """Run episodes once more whose process crashed, hung, or met a mistake of the program."""
    limit_s: float = 900.0
    """Wall time that an episode may take before its process is ended; with several processes."""


RESULTS, PAGE = "evaluation.json", "evaluation.html"
LEAST_EPISODES = 10  # Before that an interval may be narrow by luck.


def execute(options: Options) -> int:
    """Evaluate policies; return the exit code: 0 whatever the outcomes, since it is a measurement.

    Ctrl-C ends it with the results so far.
    """
    from executor.campaign.versions import EVALUATION_VERSION, outcome_version
    from executor.data.views import check_drawable
    from executor.learn.evaluation import draw_video, evaluate
    from executor.sim.render.stage import shared_renderer

    actors, version = _actors(options), outcome_version(EVALUATION_VERSION)
    kind, seeds = _kind(options, actors), range(options.seed, options.seed + options.episodes)
    if options.videos:
        check_drawable()
    if options.out is not None:
        _make(options.out)
    if _is_campaign(options):
        return _campaign(options, actors, kind, seeds, version)
    drawn: dict[tuple[str, int], Path] = {}
    with ExitStack() as stack:
        show = stack.enter_context(bar("evaluating", len(actors) * options.episodes, quiet=options.json))
        acted, total = counter(1), len(actors) * options.episodes
        pace = Pace(total, quiet=options.json)
        scene_renderer = stack.enter_context(shared_renderer()) if options.videos else None

        def show_outcome(actor: Policy, outcome: EpisodeOutcome, footage: EpisodeStates) -> None:
            done = next(acted)
            show(done, f"evaluating, {pace.text(done)}")
            pace.note(done)
            if not options.json:
                words = f"{actor.name} seed {outcome.seed}: {outcome.failure or 'succeeded'}"
                tell(f"  {done:{len(str(total))}} of {total}  {words}")
            if outcome.success_once:
                return
            if scene_renderer is not None and options.out is not None:
                folder = options.out / f"{actors.index(actor):02d}-{outcome.seed:06d}-{outcome.failure}"
                rate_hz = actor.record.rate_hz
                video = draw_video(scene_renderer(), footage, folder, options.size, rate_hz)
                drawn[actor.name, outcome.seed] = video

        found = evaluate(
            actors, kind, seeds, show_outcome, keep_states=options.videos, enough=partial(_is_enough, options.until)
        )
    whole = len(next(iter(found.values())))
    enough = whole == options.episodes or _is_enough(options.until, found)
    return _finished(options, kind, actors, found, version, drawn, DONE if enough else INTERRUPTED)


def _is_enough(until: float | None, found: Mapping[str, Sequence[EpisodeOutcome]]) -> bool:
    """Decide whether the success rate of every policy is known well enough."""
    from executor.learn.scores import PolicyScore

    if until is None or any(len(outcomes) < LEAST_EPISODES for outcomes in found.values()):
        return False
    intervals = [PolicyScore.of(outcomes).once.interval_percent or (0.0, 100.0) for outcomes in found.values()]
    return all(high - low <= until for low, high in intervals)


def _finished(
    options: Options,
    kind: EpisodeKind,
    actors: Sequence[Policy],
    found: Mapping[str, Sequence[EpisodeOutcome]],
    version: str,
    drawn: Mapping[tuple[str, int], Path],
    code: int,
) -> int:
    """Print and write the results; return the exit code."""
    from executor.cli.execution import command_line
    from executor.learn.scores import evaluation_page

    whole, judged = len(next(iter(found.values()))), _judged(kind, actors, found, drawn, options.out)
    results = {
        "version": version,
        **_results_json(kind, actors, judged, found),
        "videos": list(map(str, drawn.values())),
    }
    # Print before writing: results of hours are shown even if the disk is full by now.
    if options.json:
        print_json({"ok": code == DONE, "exit_code": code, **results})
    else:
        _print(judged)
        if code == INTERRUPTED:
            tell(f"interrupted: this is of the first {whole} of {options.episodes} episodes")
        elif code != DONE:
            tell(f"this is of the {whole} of {options.episodes} episodes that ended; --again runs the others again")
    following = command_with_videos(options)
    if options.out is not None:
        write_json(options.out / RESULTS, results)
        write_text(options.out / PAGE, evaluation_page(judged))
        following = command_line("view", options.out)
    if not options.json:
        say(f"{'next':11} {following}")
    return code


def command_with_videos(options: Options) -> str:
    """Return the command line that runs the same episodes again and draws the failures, in one process."""
    from executor.cli.execution import command_line

    usual = {field.name: field.default for field in fields(Options)}
    same = ("task", "data", "episodes", "until", "seed", "execute", "steps", "size", "threads")
    given = {name: value for name in same if (value := getattr(options, name)) != usual[name]}
    return command_line("evaluate", *options.policies, **given, out="FOLDER", videos=True)


def _is_campaign(options: Options) -> bool:
    from executor.learn.evaluation_units import INDEX

    begun = options.out is not None and (options.out / INDEX).exists()
    return begun or options.workers > 1 or options.shard != "1/1" or bool(options.slurm or options.ray)


def _campaign(options: Options, actors: list[Policy], kind: EpisodeKind, seeds: Sequence[int], version: str) -> int:
    """Run the episodes that the folder lacks in processes, print what there is, and return the exit code."""
    from executor.campaign.engine import Campaign, claimed, is_done, pending
    from executor.cli.engines import claim_wait_s, engine_of, typed_words, write_array
    from executor.cli.execution import read_shard
    from executor.learn.evaluation_units import WORKER, EvaluationFolder, EvaluationUnit, units_of
    from executor.learn.evaluation_worker import evaluation_version

    assert options.out is not None
    folder, units = EvaluationFolder(options.out), units_of(actors, kind, seeds, options.data, options.threads)
    folder.add_units(units, version)
    jobs = [(unit, version) for unit in units]
    if options.slurm is not None:
        left = sum(1 for _ in pending(folder, jobs, again=options.again))
        return write_array(options, typed_words("evaluate", options, "policies"), left, options.out, options.workers)
    shard, ran, interrupted = read_shard(options.shard), 0, False

    def so_far() -> dict[str, list[EpisodeOutcome]]:
        """Return the outcomes of the seeds in which all policies have acted."""
        by_seed: dict[int, dict[str, EpisodeOutcome]] = {seed: {} for seed in seeds}
        for unit in units:
            if (outcome := folder.outcome(unit, version)) is not None:
                by_seed[unit.seed][unit.name] = outcome
        whole = [row for row in by_seed.values() if len(row) == len(actors)]
        return {actor.name: [row[actor.name] for row in whole] for actor in actors}

    def show(unit: EvaluationUnit, result: Mapping[str, Any]) -> None:
        nonlocal ran
        ran += 1
        pace.note(ran)
        if not options.json:
            words = (result.get("failure") or {}).get("kind") or result["ended"]
            tell(f"  {ran:{len(str(len(todo)))}} of {len(todo)}  {unit.name} seed {unit.seed}: {words}")

    engine = engine_of(options, evaluation_version, renders=False)
    with claimed(folder, jobs, shard, claim_wait_s(), again=options.again) as todo:
        pace = Pace(len(todo), quiet=options.json)
        try:
            Campaign(folder, WORKER, options.workers, options.limit_s, engine=engine).run(
                todo, show, wanted=lambda unit: options.until is None or not _is_enough(options.until, so_far())
            )
        except KeyboardInterrupt:
            interrupted = True
    found = so_far()
    if not next(iter(found.values())):
        # A part may have episodes of one policy alone, or none.
        code = INTERRUPTED if interrupted else DONE if shard.of > 1 and is_done(folder, jobs, shard) else FAILED
        problem = f"no episode has ended for all policies; {len(todo) - ran} of {len(todo)} did not run"
        if options.json:
            print_json({"ok": code == DONE, "exit_code": code, "problem": problem})
        else:
            say(problem)
        return code
    whole = len(next(iter(found.values()))) == options.episodes or _is_enough(options.until, found)
    good = is_done(folder, jobs, shard) if shard.of > 1 else whole
    return _finished(
        options, kind, actors, found, version, {}, INTERRUPTED if interrupted else DONE if good else FAILED
    )


def _make(out: Path) -> None:
    """Make the folder for results, before there are any."""
    from executor.reports.run_folder import FolderUnusable

    try:
        out.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=out):
            pass
    except OSError as problem:
        raise FolderUnusable(out, problem.strerror or str(problem)) from problem


def _actors(options: Options) -> list[Policy]:
    import torch

    from executor.cli.engines import check_engine
    from executor.cli.execution import check_seed, check_unit_limit, check_workers, read_shard
    from executor.learn.acting import LeRobotPolicy, TrainedPolicy, is_stock
    from executor.sim.render.frames import check_size

    check(bool(options.policies), "POLICY", "is missing", "a folder that `train` filled")
    check(len(set(options.policies)) == len(options.policies), "POLICY", "is named twice", "each policy once")
    check(len(set(options.steps)) == len(options.steps), "--steps", " ".join(map(str, options.steps)), "each step once")
    check(options.threads > 0, "--threads", options.threads, "a number above 0")
    check_seed(options.seed, options.episodes)
    check_workers(options.workers)
    check_unit_limit(options.limit_s)
    check_engine(options, options.shard, options.out)
    read_shard(options.shard)
    check(
        options.until is None or 0.0 < options.until < 100.0, "--until", options.until, "a width from 0 to 100 points"
    )
    alone = options.until is None or (options.shard == "1/1" and options.slurm is None)
    check(alone, "--until", options.until, "no --shard and no --slurm: parts do not know of each other's episodes")
    if _is_campaign(options):
        check(options.out is not None, "--out", "is missing", "a folder for the episodes of several processes")
        check(not options.videos, "--videos", "with several processes", "--workers 1, which draws as it goes")
    if options.videos and options.out is None:
        raise BadOption("--videos", "is given", "--out with it, a folder for them")
    check_size(options.size)
    torch.set_num_threads(options.threads)
    steps = options.steps or (None,)
    actors: list[Policy] = []
    for path in options.policies:
        actors += (
            [_stock(path, options)] if is_stock(path) else [TrainedPolicy.load(path, n, options.execute) for n in steps]
        )
    for actor in actors:
        if isinstance(actor, LeRobotPolicy):
            continue
        chunk = actor.record.settings.acts.chunk
        good = 1 <= actor.execute <= chunk
        check(good, "--execute", actor.execute, f"1 to {chunk}, the actions that {actor.name} foretells")
    return actors


def _stock(path: Path, options: Options) -> LeRobotPolicy:
    from executor.learn.acting import LeRobotPolicy
    from executor.learn.demonstrations import learned_from

    if options.data is None:
        raise BadOption("--data", "is missing", f"the data set that LeRobot's policy {path} was trained on")
    check(options.execute is None, "--execute", options.execute, "none: LeRobot's policies say so by n_action_steps")
    return LeRobotPolicy(path, learned_from(options.data))


def _kind(options: Options, actors: Sequence[Policy]) -> EpisodeKind:
    """Return the kind of the episodes, and pass it to policies of LeRobot."""
    from executor.learn.acting import LeRobotPolicy

    kind = kind_of(options.task, [actor.record for actor in actors])
    # Whatever their task: the scene t1 of a seed is the kitchen that T1 draws of it.
    training_seeds = {seed for actor in actors for seed in actor.record.seeds}
    both = training_seeds & set(range(options.seed, options.seed + options.episodes))
    first, last = min(training_seeds, default=0), max(training_seeds, default=0)
    unseen = f"others than a policy was trained on, which are from {first} to {last}"
    check(not both, "--seed", options.seed, f"{unseen}: whatever the task, the same seed may draw the same room")
    for actor in actors:
        if isinstance(actor, LeRobotPolicy):
            actor.expect(kind)
    return kind


def kind_of(task: Family | None, records: Sequence[PolicyRecord]) -> EpisodeKind:
    """Return the kind of the episodes: a family, or the common kind of some policies' demonstrations."""
    from executor.data.units import Origin, scene_key
    from executor.learn.demonstrations import EpisodeKind, robot_of_kinds
    from executor.scenes.file import scene_for

    kinds = list(dict.fromkeys(kind for record in records for kind in record.kinds))
    if task is not None:
        kinds = [EpisodeKind.of(Origin(family=task), robot_of_kinds(kinds))]
    if len(kinds) > 1:
        names = list(dict.fromkeys(kind.origin.label for kind in kinds))
        kinds_text = f"several things: {', '.join(names)}" if len(names) > 1 else f"{names[0]}, varied in several ways"
        raise BadOption("--task", "is missing", f"a family, since the demonstrations are of {kinds_text}")
    origin = kinds[0].origin
    if origin.scene_key:
        scene = scene_for(origin.query, origin.scene, robot=kinds[0].robot_name)
        check(
            scene_key(scene) == origin.scene_key,
            "the scene",
            origin.scene,
            "what it was when the demonstrations were made",
        )
    return kinds[0]


def _judged(
    kind: EpisodeKind,
    actors: Sequence[Policy],
    found: Mapping[str, Sequence[EpisodeOutcome]],
    drawn: Mapping[tuple[str, int], Path],
    out: Path | None,
) -> EvaluationReport:
    from executor.cli.execution import command_line
    from executor.learn.scores import (
        EvaluationReport,
        FailedEpisode,
        PolicyScore,
        by_training,
        paired_tests,
        success_curve,
    )

    addresses = {} if out is None else {key: quote(str(video.relative_to(out))) for key, video in drawn.items()}
    scores = {name: PolicyScore.of(outcomes) for name, outcomes in found.items()}
    trained = {
        actor.name: (f"{actor.record.key_without_seed} {actor.step} {actor.execute}", actor.record.seed)
        for actor in actors
    }
    folders: dict[str, dict[int, PolicyScore]] = {}
    for actor in actors:
        folders.setdefault(actor.folder, {})[actor.step] = scores[actor.name]
    return EvaluationReport(
        what=f"{kind.origin.query or kind.origin.label}; {len(next(iter(found.values())))} episodes each",
        scores=scores,
        trainings=by_training(trained, found),
        tests=paired_tests(found),
        losses=tuple(curve for folder in folders if (curve := _loss(folder)) is not None),
        successes=tuple(
            success_curve(folder, {step: score.once for step, score in by_step.items()})
            for folder, by_step in folders.items()
            if len(by_step) > 1
        ),
        failed=[
            FailedEpisode(name, one.seed, one.failure, addresses.get((name, one.seed), ""))
            for name, all_of in found.items()
            for one in all_of
            if one.failure
        ],
        view="" if out is None else command_line("view", out),
    )


def _loss(folder: str) -> Curve | None:
    from executor.learn.policy_record import LOSSES
    from executor.learn.scores import loss_curve

    try:
        return loss_curve(folder, read_bounded_text(Path(folder) / LOSSES).splitlines())
    except (OSError, UnicodeDecodeError):
        return None


def _results_json(
    kind: EpisodeKind,
    actors: Sequence[Policy],
    judged: EvaluationReport,
    found: Mapping[str, Sequence[EpisodeOutcome]],
) -> dict[str, Any]:
    described = {
        actor.name: {
            "seed": actor.record.seed,
            "step": actor.step,
            "execute": actor.execute,
            "demonstrations": actor.record.demonstrations,
            "corrections": actor.record.takeovers,
            **judged.scores[actor.name].to_json(),
            "episodes": [outcome.to_json() for outcome in found[actor.name]],
        }
        for actor in actors
    }
    return {
        "kind": kind.to_json(),
        "policies": described,
        "trainings": [row.to_json() for row in judged.trainings],
        "pairs": [test.to_json() for test in judged.tests],
    }


def _print(judged: EvaluationReport) -> None:
    from executor.learn.scores import rate_words

    for name, score in judged.scores.items():
        say(f"{name}", style="bold")
        say(f"  {'once':11} {rate_words(score.once)}")
        say(f"  {'at the end':11} {rate_words(score.at_end)}")
        for failure, count in score.failures.items():
            say(f"  {'failed':11} {count} x {failure}")
        if score.monitors:
            counts = ", ".join(f"{kind} in {count}" for kind, count in score.monitors.items())
            say(f"  {'monitors':11} in what failed: {counts}")
    for row in judged.trainings:
        if row.spread is not None:
            shares = ", ".join(f"{100 * share:.0f}" for share in row.shares)
            seeds = ", ".join(map(str, row.seeds))
            say(f"{'seeds':11} {seeds}: {shares} %, together {rate_words(row.once)}, spread {100 * row.spread:.1f} %")
    for test in judged.tests:
        words = f"{test.first} alone {test.only_first}, {test.second} alone {test.only_second} (p = {test.p:.3g})"
        say(f"{'paired':11} {words}")
