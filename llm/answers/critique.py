"""The Inspector's answer: what it says of one executed step.

Source: the paper's critique m_(tau, j): motion verification, state contrast, anomaly detection, and the observation in
a sentence or two.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from llm.answers.base import Answer, MaybeStepNumber, Reason, Remark

Judgement = Literal["yes", "no", "unclear"]
_MEANINGS: dict[Judgement, bool | None] = {"yes": True, "no": False, "unclear": None}


def _written(value: object) -> object:
    """Returns a judgement in the words of the schema: small letters, yes or no for true or false."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return value.strip().rstrip(".").lower() if isinstance(value, str) else value


class StepCritique(Answer):
    """What was seen of one step.

    Attributes:
        step: Number of the step, from 1; None where it is not said, and then it is the one that was asked about.
        motion_verified: Whether the robot moved as the primitive means.
        state_contrast: What differs between the step's beginning and its end.
        state_reached: Whether the intended change came about.
        anomaly: What happened that should not have; empty for nothing.
        observation: The diagnosis.
    """

    step: MaybeStepNumber = Field(default=None, description="number of the judged step")
    motion_verified: Annotated[Judgement, BeforeValidator(_written)] = Field(
        description="yes, no or unclear: the robot moved as the primitive means"
    )
    state_contrast: Remark = Field(default="", description="what differs between the step's beginning and its end")
    state_reached: Annotated[Judgement, BeforeValidator(_written)] = Field(
        description="yes, no or unclear: the intended change came about"
    )
    anomaly: Remark = Field(default="", description="what happened that should not have; empty if nothing did")
    observation: Reason = Field(description="the diagnosis in one or two sentences")


def meaning(judgement: Judgement) -> bool | None:
    """Returns a judgement as a truth value, None for "unclear"."""
    return _MEANINGS[judgement]
