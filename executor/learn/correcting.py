"""Corrections: a policy acts, and where it fails the planner continues with a proved plan.

The planner's motion is a demonstration like others, except for its start, which `unit.json` records as `takeover`. It
teaches states that only policies reach: where a policy restarts (`phases.py`), which no demonstration does, and where
it stalls. Good behaviour is not interrupted: the planner mostly restarts a subtask from its start, and where a policy
is right to continue, no data should say that it goes back. Also the worker process: `python -m
executor.learn.correcting`.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch

from executor.data.store import EpisodeStore
from executor.data.units import DemoUnit
from executor.data.work import Made, NotNeeded, Prepared, noise_of
from executor.data.worker import draw_motion, run_unit
from executor.envs.scene_environment import SceneEnvironment
from executor.learn.acting import TrainedPolicy
from executor.learn.demonstrations import EpisodeKind
from executor.learn.evaluation.outcomes import OutcomeWatch
from executor.learn.evaluation.trials import PlanGuide, StallWatch, environment_for, most_steps, pusher_of
from executor.learn.observations import plan_of
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.rollout import Conditions
from executor.rollouts.takeover import continue_plan
from executor.sim.render.stage import shared_renderer
from executor.system.workers import serve

WORKER = "executor.learn.correcting"


@dataclass(frozen=True, slots=True)
class _Moment:
    """State at which the planner takes over from a policy.

    Attributes:
        start: Checkpoint for the planner.
        subtask: Index of the first undone subtask.
        phase: Number of the step that the policy takes for the running one.
        at_s: Simulated time [s].
        because: "anew", "stalled", or "time".
        pushes: Completed pushes.
    """

    start: Checkpoint
    subtask: int
    phase: int
    at_s: float
    because: str
    pushes: tuple[dict[str, Any], ...]


@dataclass
class Corrector:
    """A policy, and the planner that corrects it.

    Attributes:
        policy: The policy.
    """

    policy: TrainedPolicy
    _environments: dict[EpisodeKind, SceneEnvironment] = field(default_factory=dict)

    def make(self, unit: DemoUnit) -> Made:
        """Let the policy act in a unit's episode, and the planner continue from there.

        Raises:
            NotDrawn: No room could be drawn for the unit's seed.
            NotNeeded: The policy succeeded by itself.
            PlanRefused: The rest of the plan is not proved from there; the planner moved nothing.
        """
        env = self._environment(unit)
        moment = self._act_until_takeover(env, unit)
        episode, rate_hz = env.episode, float(unit.recording.rate_hz)
        conditions = Conditions(rate_hz, physics=episode.physics, noise=noise_of(unit), stances=unit.stances)
        done = continue_plan(episode.graph, moment.start, moment.subtask, unit.seed, conditions)
        takeover = {
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
        of = Prepared(episode.query, episode.graph, episode.perturbations)
        return Made(of, done.how.graph, done.rollout, takeover=takeover)

    def close(self) -> None:
        """Release the simulator's objects."""
        for env in self._environments.values():
            env.close()

    def _environment(self, unit: DemoUnit) -> SceneEnvironment:
        kind = EpisodeKind(unit.origin, replace(unit.variation, noise_m=0), unit.full_size)
        if kind not in self._environments:
            self._environments[kind] = environment_for(self.policy, kind)
        return self._environments[kind]

    def _act_until_takeover(self, env: SceneEnvironment, unit: DemoUnit) -> _Moment:
        """Let the policy act, and return the moment at which the planner takes over."""
        policy, rate_hz = self.policy, self.policy.record.rate_hz
        observation, info = env.reset(seed=unit.seed, options=None if unit.index is None else {"index": unit.index})
        policy.begin(plan_of(env.episode.task), unit.seed)
        watch, stall = OutcomeWatch(env.episode, env.world), StallWatch(rate_hz)
        guide = PlanGuide(policy, env.episode.task)
        pusher = pusher_of(env, unit.seed, unit.takeover.pushes if unit.takeover is not None else ())
        env.disturb(pusher)

        def now(because: str, phase: int) -> _Moment:
            subtask = min(int(info["stage"]), len(env.episode.task.subtasks) - 1)
            pushes = tuple(push.to_json() for push in pusher.applied)
            return _Moment(env.checkpoint(), subtask, phase, env.world.time_s, because, pushes)

        for _ in range(most_steps(env.family, env.episode.task, rate_hz)):
            phase = policy.phase
            action = policy.act(observation)
            if policy.restarts:
                return now("anew", phase)
            observation, _, _, _, info = env.step(action)
            watch.look(info)
            stall.look(observation["agent_pos"])
            guide.look(info)
            if watch.succeeded_s is not None:
                raise NotNeeded(f"the policy did it by itself, in {watch.succeeded_s:.1f} s")
            if stall.stalled:
                return now("stalled", policy.phase)
        return now("time", policy.phase)


def main() -> None:
    """Serve requests until standard input ends."""
    torch.set_num_threads(1)
    known: dict[tuple[str, int | None, int], Corrector] = {}
    with shared_renderer() as scene_renderer:

        def handle(request: dict[str, Any]) -> dict[str, Any]:
            unit = DemoUnit.from_json(request["unit"])
            execute = unit.takeover.execute if unit.takeover is not None else 1
            place = (request["policy"], request["step"], execute)
            if place not in known:
                known[place] = Corrector(TrainedPolicy.load(Path(place[0]), place[1], execute))
            draw = partial(draw_motion, scene_renderer()) if unit.recording.views else None
            store = EpisodeStore(Path(request["store"]))
            return run_unit(store, unit, request["version"], draw, known[place].make)

        serve(handle)


if __name__ == "__main__":
    main()
