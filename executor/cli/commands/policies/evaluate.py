"""`scene2demo evaluate`: policies in the environment, in the same episodes, and what came of them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

import torch
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from executor.cli.errors import DONE, BadOption, check
from executor.cli.executing import check_seed
from executor.cli.output import ERR, print_json, say, tell
from executor.cli.words.datasets import EvaluateOptions
from executor.datasets.footage import check_drawable
from executor.datasets.units import Origin
from executor.machine.files import content_key, json_text, write_json
from executor.pictures.render import check_size
from executor.pictures.stage import kept_draughtsman
from executor.policies.acting import Actor
from executor.policies.judging.comparison import PairedTest, PolicyScore, paired_tests
from executor.policies.judging.evaluation import Footage, evaluate
from executor.policies.judging.outcomes import EpisodeOutcome
from executor.policies.judging.videos import draw_video
from executor.policies.windows import EpisodeKind
from executor.scenes.reading import scene_for

RESULTS = "evaluation.json"


def execute(options: EvaluateOptions) -> int:
    """Evaluates policies; returns the exit code: 0 whatever they came to, since it is a measurement.

    Raises:
        NotAPolicy, BadOption: Something that was named cannot be used.
        NotDrawn: No room could be made of a seed.
        RendererNotFound, VideoFailed: Videos are wanted, and cannot be drawn.
    """
    actors = _actors(options)
    kind, seeds = _kind(options, actors), range(options.seed, options.seed + options.episodes)
    if options.videos:
        check_drawable()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    drawn: list[str] = []
    with ExitStack() as stack:
        bar = stack.enter_context(Progress(*columns, console=ERR, disable=options.json or not ERR.is_terminal))
        task = bar.add_task("evaluating", total=len(actors) * options.episodes)
        draughtsman = stack.enter_context(kept_draughtsman()) if options.videos else None

        def told(actor: Actor, outcome: EpisodeOutcome, footage: Footage) -> None:
            bar.update(task, advance=1)
            if outcome.success_once:
                return
            if not options.json:
                tell(f"  {actor.name} seed {outcome.seed}: {outcome.failure}")
            if draughtsman is not None and options.out is not None:
                folder = options.out / f"{actors.index(actor):02d}-{outcome.seed:06d}-{outcome.failure}"
                rate_hz = actor.record.rate_hz
                drawn.append(str(draw_video(draughtsman(), footage, folder, options.size, rate_hz)))

        found = evaluate(actors, kind, seeds, told, keep_states=options.videos)
    scores = {name: PolicyScore.of(outcomes) for name, outcomes in found.items()}
    tests = paired_tests(found)
    told_all = _told(kind, actors, scores, tests, found) | {"videos": drawn}
    if options.out is not None:
        write_json(options.out / RESULTS, told_all)
    if options.json:
        print_json({"ok": True, "exit_code": DONE, **told_all})
        return DONE
    _print(scores, tests)
    return DONE


def _actors(options: EvaluateOptions) -> list[Actor]:
    check(bool(options.policies), "POLICY", "is missing", "a folder that `train` filled")
    check(len(set(options.policies)) == len(options.policies), "POLICY", "is named twice", "each policy once")
    check(options.threads > 0, "--threads", options.threads, "a number above 0")
    check_seed(options.seed, options.episodes)
    if options.videos and options.out is None:
        raise BadOption("--videos", "is given", "--out beside it, a folder for them")
    check_size(options.size)
    torch.set_num_threads(options.threads)
    actors = [Actor.load(path, options.step, options.execute) for path in options.policies]
    for actor in actors:
        chunk = actor.record.settings.acts.chunk
        good = 1 <= actor.execute <= chunk
        check(good, "--execute", actor.execute, f"1 to {chunk}, the actions that {actor.name} foretells")
    return actors


def _kind(options: EvaluateOptions, actors: Sequence[Actor]) -> EpisodeKind:
    """Returns what episodes are drawn from.

    Raises:
        BadOption: It is not said, and the policies' demonstrations are of several kinds; or it is of what a policy was
            trained on.
        SceneError, SceneNotFound: The scene of the demonstrations cannot be read.
    """
    kinds = list(dict.fromkeys(kind for actor in actors for kind in actor.record.kinds))
    if options.task is not None:
        kinds = [EpisodeKind(Origin(family=options.task))]
    if len(kinds) > 1:
        names = ", ".join(kind.origin.label for kind in kinds)
        raise BadOption("--task", "is missing", f"a family, since the demonstrations are of several things: {names}")
    origin = kinds[0].origin
    seen = {
        seed for actor in actors for kind in actor.record.kinds if kind.origin == origin for seed in actor.record.seeds
    }
    both = seen & set(range(options.seed, options.seed + options.episodes))
    unseen = f"others than a policy was trained on, which are from {min(seen, default=0)} to {max(seen, default=0)}"
    check(not both, "--seed", options.seed, unseen)
    if origin.scene:
        key = content_key(json_text(scene_for(origin.query, origin.scene).to_json()))
        check(key == origin.scene_key, "the scene", origin.scene, "what it was when the demonstrations were made")
    return kinds[0]


def _told(
    kind: EpisodeKind,
    actors: Sequence[Actor],
    scores: dict[str, PolicyScore],
    tests: Sequence[PairedTest],
    found: dict[str, list[EpisodeOutcome]],
) -> dict[str, Any]:
    described = {
        actor.name: {
            "seed": actor.record.seed,
            "execute": actor.execute,
            "demonstrations": actor.record.demonstrations,
            **scores[actor.name].to_json(),
            "episodes": [outcome.to_json() for outcome in found[actor.name]],
        }
        for actor in actors
    }
    return {"kind": kind.to_json(), "policies": described, "pairs": [test.to_json() for test in tests]}


def _print(scores: dict[str, PolicyScore], tests: Sequence[PairedTest]) -> None:
    for name, score in scores.items():
        say(f"{name}", style="bold")
        for what, rate in (("once", score.once), ("at the end", score.at_end)):
            low, high = rate.interval_percent or (0.0, 100.0)
            say(f"  {what:11} {rate.successes} of {rate.trials} ({low:.1f} to {high:.1f} %)")
        for failure, count in score.failures.items():
            say(f"  {'failed':11} {count} x {failure}")
    for test in tests:
        words = f"{test.first} alone {test.only_first}, {test.second} alone {test.only_second} (p = {test.p:.3g})"
        say(f"{'paired':11} {words}")
