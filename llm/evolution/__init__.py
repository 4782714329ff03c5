"""Self-evolution: who looks at a failed attempt, who revises its flow, and what they are told.

Protocols are in `observation`; `measured` and `search` are the ones that need no model.
"""

from llm.evolution.measured import MeasuredInspector
from llm.evolution.observation import (
    AttemptSeen,
    GiveUp,
    Inspector,
    Situation,
    StartSeen,
    StepSeen,
    Supervisor,
)
from llm.evolution.search import SearchSupervisor
from oag.revision.grounds import GoalReading, Miss

__all__ = [
    "AttemptSeen",
    "GiveUp",
    "GoalReading",
    "Inspector",
    "MeasuredInspector",
    "Miss",
    "SearchSupervisor",
    "Situation",
    "StartSeen",
    "StepSeen",
    "Supervisor",
]
