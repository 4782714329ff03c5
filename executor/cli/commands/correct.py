"""`scene2demo correct`: a policy acts, the planner goes on from where it fails; the planner's part is stored."""

from __future__ import annotations

from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from executor.cli.errors import check
from executor.cli.options import CommonOptions, Family, Maybe, Pushed, Read, ResultsFolder

if TYPE_CHECKING:
    from executor.data.units import DemoSeries, DemoUnit
    from executor.learn.demonstrations import EpisodeKind
    from executor.learn.policy_record import PolicyRecord


@dataclass(frozen=True)
class Options(CommonOptions):
    """Have a policy act, and the planner go on with a proved plan from where it fails: demonstrations into a store.

    The planner takes over where the policy begins a grasp anew or stalls; what it does well by itself is counted as not
    needed. Train on the store beside others. Goes on where an earlier run with the same folder ended.
    """

    policy: tyro.conf.Positional[
        Annotated[
            Path,
            tyro.conf.arg(metavar="POLICY", help="Folder that `train` filled.", help_behavior_hint="(required)"),
            Read(),
        ]
    ]
    out: ResultsFolder
    task: Maybe[Family] = None
    """A family of the benchmark; by default what the policy was trained on."""
    episodes: int = 50
    """How many episodes."""
    seed: int = 0
    """Seed of the first episode; the following ones count up."""
    execute: Maybe[int] = None
    """How many actions of a chunk are done before the policy looks again; by default what its settings say."""
    step: Maybe[int] = None
    """The weights after so many steps of training, where they were kept; by default the last."""
    push: Annotated[tuple[Pushed, ...], tyro.conf.arg(metavar="base|item...", help_behavior_hint="")] = ()
    """What is pushed once while the policy acts."""
    noise_m: float = 0.0
    """Noise in what the planner tells the hand, in metres; recorded actions are without it."""
    stances: int = 4
    """How many stances to plan, as `generate` does."""
    workers: int = 2
    """How many processes; one that crashes costs its episode only."""
    limit_s: float = 900.0
    """Wall time that an episode may take before its process is ended."""


_MOST_NOISE_M = 0.05


def execute(options: Options) -> int:
    """Make the missing corrections; return the exit code."""
    from executor.campaign.engine import Campaign
    from executor.cli.commands.generate import make_missing
    from executor.data.store import EpisodeStore
    from executor.learn.correcting import WORKER
    from executor.learn.policy_record import read_record

    record = read_record(options.policy)
    series = _series(options, record)
    if options.task is not None:
        _check_learned(options, series.first)
    # A worker starts wherever it likes.
    fields = {"policy": str(options.policy.resolve()), "step": options.step}
    campaign = Campaign(EpisodeStore(options.out), WORKER, options.workers, options.limit_s, lambda *job: fields)
    return make_missing(campaign, [series], as_json=options.json)


def _series(options: Options, record: PolicyRecord) -> DemoSeries:
    """Return the requested series, after refusing options that make no sense."""
    from executor.cli.commands.evaluate import kind_of
    from executor.cli.execution import check_seed, check_unit_limit, check_workers
    from executor.data.units import MOST_STANCES, DemoSeries, DemoUnit, Recording, Takeover
    from executor.learn.policy_record import policy_key
    from executor.scenes.generators.families import indices_of

    check_seed(options.seed, options.episodes)
    check_workers(options.workers)
    check_unit_limit(options.limit_s)
    check(0.0 <= options.noise_m <= _MOST_NOISE_M, "--noise-m", options.noise_m, f"0 to {_MOST_NOISE_M}")
    check(1 <= options.stances <= MOST_STANCES, "--stances", options.stances, f"1 to {MOST_STANCES}")
    check(len(set(options.push)) == len(options.push), "--push", " ".join(options.push), "each thing once")
    settings = record.settings
    expected = "one that is told the primitive that is going on (phase = true), as else corrections contradict the rest"
    check(settings.sees.phase, "POLICY", options.policy, expected)
    count = settings.acts.execute if options.execute is None else options.execute
    check(1 <= count <= settings.acts.chunk, "--execute", count, f"1 to {settings.acts.chunk}, the actions of a chunk")
    kind: EpisodeKind = kind_of(options.task, [record])
    family = kind.origin.family
    unit = DemoUnit(
        kind.origin,
        options.seed,
        indices_of(family)[0],
        replace(kind.variation, noise_m=options.noise_m),
        Recording(rate_hz=record.rate_hz),
        full_size=kind.full_size,
        stances=options.stances,
        takeover=Takeover(policy_key(options.policy, options.step), count, options.push),
    )
    return DemoSeries(unit, options.episodes)


def _check_learned(options: Options, first: DemoUnit) -> None:
    """Refuse a task with steps that the policy has never learned, before hundreds of its episodes fail so."""
    from executor.learn.acting import TrainedPolicy
    from executor.learn.demonstrations import EpisodeKind
    from executor.learn.evaluation.trials import environment_for
    from executor.learn.observations import plan_of
    from executor.scenes.pair import NotDrawn

    actor = TrainedPolicy.load(options.policy, options.step)
    kind = EpisodeKind(first.origin, replace(first.variation, noise_m=0), first.full_size)
    with closing(environment_for(actor, kind)) as env, suppress(NotDrawn):
        env.reset(seed=first.seed, options=None if first.index is None else {"index": first.index})
        actor.begin(plan_of(env.episode.task), first.seed)
