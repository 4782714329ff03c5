"""Self-evolution: who looks at a failed attempt, who revises its flow, and what they are told.

Protocols are in `inspector` and `supervisor`; `measured` and `search` are the ones that need no model.
"""

from llm.evolution.inspector import Inspector
from llm.evolution.measured import MeasuredInspector
from llm.evolution.observation import AttemptSeen, Condition, StartSeen, StepSeen
from llm.evolution.search import SearchSupervisor
from llm.evolution.supervisor import GiveUp, Situation, Supervisor
from oag.revision.grounds import Miss

__all__ = [
    "AttemptSeen",
    "Condition",
    "GiveUp",
    "Inspector",
    "MeasuredInspector",
    "Miss",
    "SearchSupervisor",
    "Situation",
    "StartSeen",
    "StepSeen",
    "Supervisor",
]
