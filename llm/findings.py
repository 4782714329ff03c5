"""What can be wrong with a model's answer beyond what `oag` reports of plans: the codes, and how one is made.

Findings are `oag.Diagnostic`s, so that a model is told everything in one form.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from oag import Diagnostic
from oag.model.diagnostic import Severity

ANSWER_CODES: Mapping[str, str] = MappingProxyType(
    {
        "answer/no-json": "The reply holds no JSON object.",
        "answer/broken-json": "The reply's JSON object cannot be read.",
        "answer/cut-off": "The reply ended at the limit of tokens.",
        "answer/too-long": "The reply is longer than any answer can be.",
        "answer/field": "A field is missing, has the wrong type, or is out of its bounds.",
        "answer/numbering": "The subtasks are not numbered 1, 2, 3 ..., one entry each.",
        "answer/empty-goal": "The task goal asks for nothing that is not so already.",
        "answer/unnamed-object": "The task goal speaks of an object that the task's name and description leave out.",
        "answer/other-reading": "Read word by word, the query asks for something else than the task goal says.",
        "answer/category": "The category is not the one that the scene gives the object.",
        "answer/target": "The object is not the target of the subtask.",
        "answer/off-target": "A subtask's condition does not speak of the subtask's target.",
        "answer/scale": "The factor does not follow the rule of size adjustment.",
        "answer/repeated": "The answer is one that was refused already.",
        "answer/step": "The step is none that ran, or not the one that was asked about.",
        "answer/contradictory": "Two parts of the answer exclude each other.",
        "answer/empty-flow": "Neither a flow is given nor a reason why there is none.",
        "answer/against-measurement": "The answer says the opposite of what was measured.",
    }
)


def finding(
    code: str,
    message: str,
    place: str = "",
    *,
    subtask: int | None = None,
    hint: str | None = None,
    severity: Severity = "error",
) -> Diagnostic:
    """Returns one finding about an answer; `code` is one of ANSWER_CODES, or one of `oag`'s own."""
    return Diagnostic(code, severity, message, place, subtask, hint=hint)


def said_by(found: Diagnostic) -> tuple[str, ...]:
    """Returns what makes a finding the same as another one: what it says, about what, and where."""
    return (found.code, found.place, found.literal or "", found.message)


def errors_of(findings: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Returns the findings with which an answer cannot be used."""
    return tuple(found for found in findings if found.severity == "error")
