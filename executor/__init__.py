"""Everything that moves: scenes, the robot, physics, cameras, recordings, and the command line.

The names below are imported when they are first used, so that `import executor` loads neither simulator nor torch.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from executor.datasets.robomimic import write_robomimic
    from executor.episode import Episode
    from executor.evolution import evolve
    from executor.evolution_record import Evolution
    from executor.execution import resume, rollout
    from executor.records import Failure, FailureKind, Rollout
    from executor.render.frames import Frames
    from executor.scene_source import load_scene
    from executor.scenes.library import names as scene_names
    from executor.scenes.vary import vary
    from executor.stops import MissingFlow, PlanRefused, RolloutInterrupted
    from executor.video import write_video

__all__ = [
    "Episode",
    "Evolution",
    "Failure",
    "FailureKind",
    "Frames",
    "MissingFlow",
    "PlanRefused",
    "Rollout",
    "RolloutInterrupted",
    "evolve",
    "load_scene",
    "resume",
    "rollout",
    "scene_names",
    "vary",
    "write_robomimic",
    "write_video",
]

_PLACES = {
    "Episode": ("executor.episode", "Episode"),
    "Evolution": ("executor.evolution_record", "Evolution"),
    "Failure": ("executor.records", "Failure"),
    "FailureKind": ("executor.records", "FailureKind"),
    "Frames": ("executor.render.frames", "Frames"),
    "MissingFlow": ("executor.stops", "MissingFlow"),
    "PlanRefused": ("executor.stops", "PlanRefused"),
    "Rollout": ("executor.records", "Rollout"),
    "RolloutInterrupted": ("executor.stops", "RolloutInterrupted"),
    "evolve": ("executor.evolution", "evolve"),
    "load_scene": ("executor.scene_source", "load_scene"),
    "resume": ("executor.execution", "resume"),
    "rollout": ("executor.execution", "rollout"),
    "scene_names": ("executor.scenes.library", "names"),
    "vary": ("executor.scenes.vary", "vary"),
    "write_robomimic": ("executor.datasets.robomimic", "write_robomimic"),
    "write_video": ("executor.video", "write_video"),
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'executor' has no attribute {name!r}")
    module, attribute = _PLACES[name]
    value = getattr(importlib.import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
