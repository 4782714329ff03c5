"""The Supervisor's answer: the root cause, the revised flow with its reason, or why there is none.

Source: the paper's raw outputs, `"reason"` and `"new_sequence"`; its three reasoning steps are root cause, revision,
library. The fields stand in this order, so that a model writes the cause before the flow. The paper's two are enough.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, Field

from llm.answers.base import MOST_ACTIONS, Answer, MaybeLine, MaybeNumber, MaybeStepNumber, Reason, Remark
from llm.answers.flows import WireStep
from oag import ActionFlow


class RevisedFlow(Answer):
    """What a supervisor makes of a failed attempt.

    Attributes:
        sub_task: Number of the simple task whose flow is revised: the one that failed, or an earlier one to blame. None
            where it is not said: the one that failed.
        root_cause_step: Number of the earliest failed or risky step of its flow, from 1; None where it is not said.
        root_cause: The root cause in a few words; empty where it is not said.
        reason: Why it failed, what is changed, and why that helps.
        problem: Why no flow of the library can help; empty when one is given.
        new_sequence: The revised flow; empty when there is a problem.
    """

    sub_task: MaybeNumber = Field(default=None, description="number of the simple task whose flow is revised")
    root_cause_step: MaybeStepNumber = Field(default=None, description="number of the earliest failed or risky step")
    root_cause: MaybeLine = Field(default="", description="the root cause in a few words")
    reason: Reason = Field(description="why it failed, what is changed, and why that helps")
    problem: Remark = Field(default="", description="why no flow can help; empty if one is given")
    new_sequence: Annotated[list[WireStep], BeforeValidator(lambda value: [] if value is None else value)] = Field(
        default=[], max_length=MOST_ACTIONS
    )

    @property
    def flow(self) -> ActionFlow:
        """The revised flow."""
        return tuple(step.action() for step in self.new_sequence)
