"""The Supervisor's answer: the root cause, the revised flow with its reason, or why there is none.

Source: the paper's raw outputs, `"reason"` and `"new_sequence"`; its three reasoning steps are root cause, revision,
library. The fields stand in this order, so that a model writes the cause before the flow.
"""

from __future__ import annotations

from pydantic import Field

from llm.answers.base import MOST_ACTIONS, Answer, Line, Number, Reason, Remark
from llm.answers.flows import WireStep
from oag import ActionFlow


class RevisedFlow(Answer):
    """What a supervisor makes of a failed attempt.

    Attributes:
        sub_task: Number of the simple task whose flow is revised: the one that failed, or an earlier one to blame.
        root_cause_step: Number of the earliest failed or risky step of its flow, from 1.
        root_cause: The root cause in a few words.
        reason: Why it failed, what is changed, and why that helps.
        problem: Why no flow of the library can help; empty when one is given.
        new_sequence: The revised flow; empty when there is a problem.
    """

    sub_task: Number = Field(description="number of the simple task whose flow is revised")
    root_cause_step: int = Field(ge=1, le=1_000, description="number of the earliest failed or risky step")
    root_cause: Line = Field(description="the root cause in a few words")
    reason: Reason = Field(description="why it failed, what is changed, and why that helps")
    problem: Remark = Field(description="why no flow can help; empty if one is given")
    new_sequence: list[WireStep] = Field(max_length=MOST_ACTIONS)

    @property
    def flow(self) -> ActionFlow:
        """The revised flow."""
        return tuple(step.action() for step in self.new_sequence)
