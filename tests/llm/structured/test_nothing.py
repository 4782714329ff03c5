"""Texts that say that there is nothing to say, and texts that only look so."""

from __future__ import annotations

import pytest

from llm.structured.schema import begins_with_denial, is_empty_remark


@pytest.mark.parametrize(
    "text",
    [
        "", " ", "-", "None", "none.", "null", "N/A", "n/a.", "Not applicable.", "None observed.", "No anomalies",
        "No anomaly was detected during this step.", "No problems.", "There are no issues.", "Nothing unusual.",
        "Nothing unexpected was observed.", "No collisions or unexpected movement.", "Without problems",
        "Nothing to report.",
        "No unintended contact with any of the other", "No faults!",
    ],
)  # fmt: skip
def test_nothing_is_said(text: str) -> None:
    assert is_empty_remark(text)


@pytest.mark.parametrize(
    "text",
    [
        "No contact was made.", "No contact detected", "Nothing was grasped.", "Nothing happened.", "No motion.",
        "No grasp was found", "None of the fingers touches the handle.", "Not closed.", "The door hit the wall.",
        "A problem.", "collision", "There is a collision.", "No anomalies, but the glass fell.", "nonesuch",
        "No door.", "Nobody knows.", "No. It fell.", "no " * 400 + "problem",
    ],
)  # fmt: skip
def test_something_is_said(text: str) -> None:
    assert not is_empty_remark(text)


def test_what_begins_like_a_denial_is_asked_about() -> None:
    assert begins_with_denial("No contact was made.") and begins_with_denial("Nothing was grasped")
    assert not begins_with_denial("The door hit the wall; no contact with the glass.") and not begins_with_denial("")
