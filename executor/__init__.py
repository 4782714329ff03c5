"""Scenes, robot, physics, cameras, recordings, data sets, policies, and the command line.

The names below are imported on first use, so that `import executor` loads neither simulator nor torch.
"""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from executor.data.episode import Episode
    from executor.data.formats.robomimic import write_robomimic
    from executor.data.store import EpisodeStore
    from executor.records import Failure, FailureKind, MissingFlow, PlanRefused, Rollout, RolloutInterrupted
    from executor.rollouts.evolution_record import Evolution
    from executor.rollouts.evolve import evolve
    from executor.rollouts.feasibility import Feasibility, feasible
    from executor.rollouts.recording import repeat
    from executor.rollouts.rollout import resume, rollout
    from executor.scenes.file import load_scene
    from executor.scenes.library import names as scene_names
    from executor.scenes.vary import vary
    from executor.sim.render.frames import Frames, write_video
    from executor.skills.library import add_skill

__all__ = [
    "Episode",
    "EpisodeStore",
    "Evolution",
    "Failure",
    "FailureKind",
    "Feasibility",
    "Frames",
    "MissingFlow",
    "PlanRefused",
    "Rollout",
    "RolloutInterrupted",
    "add_skill",
    "evolve",
    "feasible",
    "load_scene",
    "repeat",
    "resume",
    "rollout",
    "scene_names",
    "vary",
    "write_robomimic",
    "write_video",
]

_PLACES = {
    "Episode": ("executor.data.episode", "Episode"),
    "EpisodeStore": ("executor.data.store", "EpisodeStore"),
    "Evolution": ("executor.rollouts.evolution_record", "Evolution"),
    "Failure": ("executor.records", "Failure"),
    "FailureKind": ("executor.records", "FailureKind"),
    "Feasibility": ("executor.rollouts.feasibility", "Feasibility"),
    "Frames": ("executor.sim.render.frames", "Frames"),
    "MissingFlow": ("executor.records", "MissingFlow"),
    "PlanRefused": ("executor.records", "PlanRefused"),
    "Rollout": ("executor.records", "Rollout"),
    "RolloutInterrupted": ("executor.records", "RolloutInterrupted"),
    "add_skill": ("executor.skills.library", "add_skill"),
    "evolve": ("executor.rollouts.evolve", "evolve"),
    "feasible": ("executor.rollouts.feasibility", "feasible"),
    "load_scene": ("executor.scenes.file", "load_scene"),
    "repeat": ("executor.rollouts.recording", "repeat"),
    "resume": ("executor.rollouts.rollout", "resume"),
    "rollout": ("executor.rollouts.rollout", "rollout"),
    "scene_names": ("executor.scenes.library", "names"),
    "vary": ("executor.scenes.vary", "vary"),
    "write_robomimic": ("executor.data.formats.robomimic", "write_robomimic"),
    "write_video": ("executor.sim.render.frames", "write_video"),
}


def require_own_packages() -> None:
    """Raise ImportError if `bddl`, `oag` or `llm` is another package, such as one in the start folder."""
    home = Path(__file__).resolve().parents[1]
    for name in ("bddl", "oag", "llm"):
        spec = importlib.util.find_spec(name)
        place = None if spec is None or spec.origin is None else Path(spec.origin).resolve().parent
        if place != home / name:
            raise ImportError(
                f"executor needs this project's own `{name}` package, but Python finds another one: {place or 'none'}; "
                "start from a folder without it, or install scene2demo in an environment of its own"
            )


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'executor' has no attribute {name!r}")
    require_own_packages()
    module, attribute = _PLACES[name]
    value = getattr(importlib.import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
