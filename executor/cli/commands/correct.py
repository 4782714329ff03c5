"""`scene2demo correct`: a policy acts, the planner goes on from where it fails; the planner's part is stored."""

from __future__ import annotations

from contextlib import closing, suppress
from dataclasses import replace

from executor.campaign.engine import Campaign
from executor.campaign.versions import outcome_version
from executor.cli.commands.evaluate import kind_of
from executor.cli.commands.generate import Missing, make_missing
from executor.cli.data_options import CorrectOptions
from executor.cli.errors import check
from executor.cli.execution import check_seed, check_unit_limit, check_workers
from executor.data.store import EpisodeStore
from executor.data.units import MOST_STANCES, DemoSeries, DemoUnit, Recording, Takeover
from executor.learn.acting import TrainedPolicy
from executor.learn.correcting import WORKER
from executor.learn.demonstrations import EpisodeKind
from executor.learn.evaluation.trials import environment_for
from executor.learn.observations import plan_of
from executor.learn.policy_record import PolicyRecord, policy_key, read_record
from executor.scenes.generators.families import indices_of
from executor.scenes.pair import NotDrawn

_MOST_NOISE_M = 0.05


def execute(options: CorrectOptions) -> int:
    """Make the missing corrections; return the exit code.

    Raises:
        NotAPolicy, NotADataset, BadOption, SceneError, SceneNotFound: Something that was named cannot be used.
    """
    record = read_record(options.policy)
    series = _series(options, record)
    if options.task is not None:
        _check_learned(options, series.first)
    # A worker starts wherever it likes.
    fields = {"policy": str(options.policy.resolve()), "step": options.step}
    campaign = Campaign(EpisodeStore(options.out), WORKER, options.workers, options.limit_s, lambda *job: fields)
    return make_missing(campaign, Missing([series], outcome_version()), as_json=options.json)


def _series(options: CorrectOptions, record: PolicyRecord) -> DemoSeries:
    """Return the requested series, after refusing options that make no sense."""
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


def _check_learned(options: CorrectOptions, first: DemoUnit) -> None:
    """Refuse a task with steps that the policy has never learned, before hundreds of its episodes fail so.

    Raises:
        NotAPolicy: It is one; or the policy's weights are missing.
    """
    actor = TrainedPolicy.load(options.policy, options.step)
    kind = EpisodeKind(first.origin, replace(first.variation, noise_m=0), first.full_size)
    with closing(environment_for(actor, kind)) as env, suppress(NotDrawn):
        env.reset(seed=first.seed, options=None if first.index is None else {"index": first.index})
        actor.begin(plan_of(env.episode.task), first.seed)
