"""Self-evolution: the Inspector that judges an attempt, the Supervisor that revises its flow, their inputs.

Protocols are in `observation`. `rules` has the judges that need no model, `judges` those of a model.
"""

from llm.evolve.observation import (
    AttemptObservation,
    GiveUp,
    Inspector,
    Situation,
    StartObservation,
    StepObservation,
    Supervisor,
)
from llm.evolve.rules import MeasuredInspector, SearchSupervisor
from oag.measurements import GoalReading, Miss

__all__ = [
    "AttemptObservation",
    "GiveUp",
    "GoalReading",
    "Inspector",
    "MeasuredInspector",
    "Miss",
    "SearchSupervisor",
    "Situation",
    "StartObservation",
    "StepObservation",
    "Supervisor",
]
