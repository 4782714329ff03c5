"""Corrections: a policy acts, and from where it fails the planner goes on with a proved plan.

What the planner then does is a demonstration like others, but for where it begins, and says so: `takeover` in its
`unit.json`. It tells a policy what to do where only a policy gets to: where it begins anew (`phases.py`), which no
demonstration does, and where it stalls. What a policy does well is not interrupted, as the planner mostly begins a
subtask from its start, and where a policy is right to go on nothing may say that it goes back. Also the process that
makes them, one after the other: `python -m executor.policies.correcting`.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch

from executor.datasets.store import EpisodeStore
from executor.datasets.units import DemoUnit
from executor.datasets.work import Made, NotNeeded, Prepared, noise_of
from executor.datasets.worker import drawn, run_unit
from executor.envs.environment import SceneEnvironment
from executor.machine.workers.process import serve
from executor.pictures.stage import kept_draughtsman
from executor.policies.acting import Actor
from executor.policies.judging.evaluation import PlanGuide, environment_for, most_steps, pusher_of
from executor.policies.judging.helping import StallWatch
from executor.policies.judging.outcomes import OutcomeWatch
from executor.policies.steps import plan_of
from executor.policies.windows import EpisodeKind
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.continuing import continue_plan

WORKER = "executor.policies.correcting"


@dataclass(frozen=True, slots=True)
class _Moment:
    """Where a policy has brought things.

    Attributes:
        start: All that the planner needs to go on.
        subtask: Index of the subtask that is not done.
        phase: Number of the step that the policy takes to be going on.
        at_s: Simulated time.
        because: "anew", "stalled", or "time".
        pushes: What pushed until then, as it was.
    """

    start: Checkpoint
    subtask: int
    phase: int
    at_s: float
    because: str
    pushes: tuple[dict[str, Any], ...]


@dataclass
class Corrector:
    """A policy, and the planner that puts it right.

    Attributes:
        actor: The policy.
    """

    actor: Actor
    _environments: dict[EpisodeKind, SceneEnvironment] = field(default_factory=dict)

    def make(self, unit: DemoUnit) -> Made:
        """Returns what the planner does from where the policy comes to in a unit's episode.

        Raises:
            NotDrawn: No room could be made of the unit's seed.
            NotNeeded: The policy did it by itself.
            PlanRefused: The rest of the plan is not proved from there; the planner moved nothing.
        """
        env = self._environment(unit)
        moment = self._acted(env, unit)
        episode, rate_hz = env.episode, float(unit.recording.rate_hz)
        done = continue_plan(
            episode.graph,
            moment.start,
            moment.subtask,
            unit.seed,
            rate_hz,
            stances=unit.stances,
            physics=episode.physics,
            noise=noise_of(unit),
        )
        told = {
            "policy": unit.takeover.policy if unit.takeover is not None else "",
            "because": moment.because,
            "at_s": round(moment.at_s, 3),
            **({"pushes": list(moment.pushes)} if moment.pushes else {}),
            "phase": moment.phase,
            "subtask": moment.subtask,
            "first_step": done.how.first_step,
            "task": episode.task.to_json(),
            "start": json.loads(moment.start.to_bytes()),
        }
        of = Prepared(episode.query, episode.graph, episode.strays)
        return Made(of, done.how.graph, done.rollout, takeover=told)

    def close(self) -> None:
        """Lets go of the simulator's objects."""
        for env in self._environments.values():
            env.close()

    def _environment(self, unit: DemoUnit) -> SceneEnvironment:
        kind = EpisodeKind(unit.origin, replace(unit.variation, noise_m=0), unit.full_size)
        if kind not in self._environments:
            self._environments[kind] = environment_for(self.actor, kind)
        return self._environments[kind]

    def _acted(self, env: SceneEnvironment, unit: DemoUnit) -> _Moment:
        """Has the policy act, and returns the moment at which the planner takes over."""
        actor, rate_hz = self.actor, self.actor.record.rate_hz
        observation, info = env.reset(seed=unit.seed, options=None if unit.index is None else {"index": unit.index})
        actor.begin(plan_of(env.episode.task), unit.seed)
        watch, stall = OutcomeWatch(env.episode, env.world), StallWatch(rate_hz)
        guide = PlanGuide(actor, env.episode.task)
        pusher = pusher_of(env, unit.seed, unit.takeover.pushes if unit.takeover is not None else ())
        env.disturb(pusher)

        def now(because: str, phase: int) -> _Moment:
            subtask = min(int(info["stage"]), len(env.episode.task.subtasks) - 1)
            pushes = tuple(push.to_json() for push in pusher.applied)
            return _Moment(env.checkpoint(), subtask, phase, env.world.time_s, because, pushes)

        for _ in range(most_steps(env.family, env.episode.task, rate_hz)):
            phase = actor.phase
            action = actor.act(observation)
            if actor.anew:
                return now("anew", phase)
            observation, _, _, _, info = env.step(action)
            watch.look(info)
            stall.look(observation["agent_pos"])
            guide.look(info)
            if watch.succeeded_s is not None:
                raise NotNeeded(f"the policy did it by itself, in {watch.succeeded_s:.1f} s")
            if stall.stalled:
                return now("stalled", actor.phase)
        return now("time", actor.phase)


def main() -> None:
    """Serves requests until standard input ends."""
    torch.set_num_threads(1)
    known: dict[tuple[str, int | None, int], Corrector] = {}
    with kept_draughtsman() as draughtsman:

        def handle(request: dict[str, Any]) -> dict[str, Any]:
            unit = DemoUnit.from_json(request["unit"])
            execute = unit.takeover.execute if unit.takeover is not None else 1
            place = (request["policy"], request["step"], execute)
            if place not in known:
                known[place] = Corrector(Actor.load(Path(place[0]), place[1], execute))
            draw = partial(drawn, draughtsman()) if unit.recording.views else None
            store = EpisodeStore(Path(request["store"]))
            return run_unit(store, unit, request["version"], draw, known[place].make)

        serve(handle)


if __name__ == "__main__":
    main()
