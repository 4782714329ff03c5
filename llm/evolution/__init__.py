"""Self-evolution: who looks at a failed attempt, who revises its flow, and what they are told.

Protocols are in `inspector` and `supervisor`; `measured` and `search` are the ones that need no model.
"""

from llm.evolution.inspector import Inspector
from llm.evolution.measured import MeasuredInspector
from llm.evolution.observation import AttemptSeen, StartSeen, StepSeen
from llm.evolution.search import SearchSupervisor
from llm.evolution.supervisor import GiveUp, Situation, Supervisor
from oag.revision.grounds import Miss, Reading

__all__ = [
    "AttemptSeen",
    "GiveUp",
    "Inspector",
    "MeasuredInspector",
    "Miss",
    "Reading",
    "SearchSupervisor",
    "Situation",
    "StartSeen",
    "StepSeen",
    "Supervisor",
]
