"""The closed list of diagnostic codes: what each means and how the Embodied Agent Interface labels the mistake."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class CodeInfo:
    """What a diagnostic code stands for.

    Attributes:
        meaning: One sentence.
        eai: Label in the Embodied Agent Interface's taxonomy of errors, None where it has none.
    """

    meaning: str
    eai: str | None = None


CODES: Mapping[str, CodeInfo] = MappingProxyType(
    {
        "bddl/syntax": CodeInfo("A formula's text is no BDDL, such as one with a missing parenthesis.", "PARSE_ERROR"),
        "bddl/unknown-predicate": CodeInfo("A formula uses a predicate that the vocabulary lacks.", "HALLUCINATION"),
        "bddl/unknown-object": CodeInfo("A role or a formula names an object that the scene lacks.", "UNSEEN_OBJECT"),
        "bddl/unknown-category": CodeInfo("A quantifier ranges over a category of which the scene has no object."),
        "bddl/too-many-instances": CodeInfo("The quantifiers of a task say too much to be decided in this scene."),
        "bddl/arity": CodeInfo("A predicate has too few or too many arguments.", "PARAMETER_ERROR"),
        "bddl/kind": CodeInfo("A formula says of an object what its kind cannot be.", "AFFORDANCE_ERROR"),
        "task/role-scope": CodeInfo("The roles of a subtask do not fit each other or its goal.", "PARAMETER_ERROR"),
        "task/contradictory": CodeInfo("A condition, or the scene's facts, cannot be true in any state."),
        "task/vacuous": CodeInfo("A subtask's goal holds already when it starts.", "ADDITIONAL_STEP"),
        "task/empty": CodeInfo("A task has no subtasks, so nothing is done.", "MISSING_STEP"),
        "task/size": CodeInfo("An item is too wide to be grasped, or is scaled by too much.", "AFFORDANCE_ERROR"),
        "task/scaled": CodeInfo("An object is run at another size than it has in the scene."),
        "flow/unknown-primitive": CodeInfo("A flow uses a primitive that does not exist.", "HALLUCINATION"),
        "flow/parameter": CodeInfo("A primitive's parameter has the wrong form or range.", "PARAMETER_ERROR"),
        "flow/unfilled": CodeInfo("Numbers are left for the executor's geometric planner to fill in."),
        "flow/kind": CodeInfo("A primitive acts on an object whose kind it cannot act on.", "AFFORDANCE_ERROR"),
        "flow/no-flow": CodeInfo("A subtask has no action flow: none was given, and none exists or was found."),
        "flow/searched": CodeInfo("A subtask came without a flow, and a search found one."),
        "flow/precondition": CodeInfo("A primitive's precondition does not hold when it runs.", "MISSING_STEP"),
        "flow/goal-not-reached": CodeInfo("A subtask's goal does not hold when its flow has run.", "MISSING_STEP"),
        "locality/outside-scope": CodeInfo("A step changes an object that its subtask does not speak of."),
        "locality/clobbers": CodeInfo("A step undoes another subtask's goal, which its own is not there to change."),
        "locality/cargo": CodeInfo("What lies on or in the grasped object moves with it."),
        "context/start": CodeInfo("The first subtask's initial condition is false at the start."),
        "context/refuted": CodeInfo("A later subtask's initial condition is false where it starts.", "MISSING_STEP"),
        "context/open": CodeInfo("What a step or a condition needs is unknown."),
        "context/undecided": CodeInfo(
            "The solver's time ran out before the plan was decided exactly, or too much was unknown."
        ),
        "context/goal-gap": CodeInfo("A subtask's goal says less than what the rest of the plan needs of it."),
        "goal/not-reached": CodeInfo("The task goal does not hold at the end.", "MISSING_STEP"),
        "goal/undone": CodeInfo("A step undoes what a subtask had reached of the task goal.", "WRONG_TEMPORAL_ORDER"),
        "revision/repeated": CodeInfo("A revised flow is one that failed already, up to a tolerance on its numbers."),
        "revision/assumes": CodeInfo("A revised flow needs something unknown that the flow before did not need."),
        "revision/too-long": CodeInfo("A revised flow has more steps than a revision may have."),
        "revision/exhausted": CodeInfo("A subtask was revised as often as the history allows."),
    }
)

WRONG_ORDER = "WRONG_TEMPORAL_ORDER"


def eai_label(code: str) -> str | None:
    """Returns the Embodied Agent Interface's label for a code, or None where its taxonomy has none."""
    return CODES[code].eai
