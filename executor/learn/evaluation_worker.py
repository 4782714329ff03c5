"""Worker process that runs policies in episodes: `python -m executor.learn.evaluation_worker`."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import torch

from executor.campaign.versions import EVALUATION_VERSION, outcome_version
from executor.envs.scene_environment import SceneEnvironment
from executor.learn.acting import LeRobotPolicy, Policy, TrainedPolicy
from executor.learn.demonstrations import learned_from
from executor.learn.evaluation import environment_for, run_episode
from executor.learn.evaluation_units import kind_of_unit
from executor.learn.policy_record import read_record
from executor.system.files import plain
from executor.system.workers import check_version, serve


def evaluation_version() -> str:
    """Return the version of this program's evaluations."""
    return outcome_version(EVALUATION_VERSION)


@lru_cache(maxsize=8)
def _at_work(policy: str, step: int, execute: int, data: str, kind: str) -> tuple[Policy, SceneEnvironment]:
    """Return a policy with an environment of its own, as it was for the episode before."""
    episodes = kind_of_unit({"kind": kind})
    actor: Policy
    if data:
        actor = LeRobotPolicy(Path(policy), learned_from(Path(data)))
        actor.expect(episodes)
    else:
        last = read_record(Path(policy)).settings.training.steps
        actor = TrainedPolicy.load(Path(policy), None if step == last else step, execute)
    return actor, environment_for(actor, episodes)


def _handle(request: dict[str, Any]) -> dict[str, Any]:
    check_version(request["version"], evaluation_version())
    torch.set_num_threads(request["threads"])
    actor, env = _at_work(*(request[name] for name in ("policy", "step", "execute", "data", "kind")))
    outcome, _ = run_episode(env, actor, request["seed"])
    ended = "succeeded" if outcome.success_once else "failed"
    failure = {"kind": outcome.failure, "message": ""} if outcome.failure else None
    answer: dict[str, Any] = plain({"ended": ended, "failure": failure, "outcome": outcome.to_json()})
    return answer


def main() -> None:
    """Serve requests until standard input ends."""
    serve(_handle)


if __name__ == "__main__":
    main()
