"""A correction for another flow: the same change where there is what it hangs on, else none."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given

from llm.memory import transfer
from oag.model.actions import ActionFlow, flow_from_json, flow_to_json
from tests.llm.memory.notes import flows


def moved(before: list[Any], after: list[Any], flow: list[Any]) -> list[Any] | None:
    """Return the transfer in the paper's form."""
    found = transfer(*(flow_from_json(part) for part in (before, after, flow)))
    return None if found is None else flow_to_json(found)


@given(flows, flows)
def test_the_flow_of_then_becomes_what_it_became_then(before: ActionFlow, after: ActionFlow) -> None:
    assert transfer(before, after, before) == after


@given(flows, flows)
def test_no_change_changes_nothing(before: ActionFlow, flow: ActionFlow) -> None:
    assert transfer(before, before, flow) == flow


@pytest.mark.parametrize(
    ("before", "after", "flow", "expected"),
    [
        # The limits of a joint are taken as they are.
        ([17, 3, {"19": [0.0, 0.5]}], [17, 3, {"19": [0.0, 0.9]}], [3, {"19": [0.0, 0.4]}], [3, {"19": [0.0, 0.9]}]),
        # A distance is changed by as much.
        ([18, {"13": 0.4}, 5], [18, {"13": 0.5}, 5], [18, {"13": 0.2}, 5], [18, {"13": 0.3}, 5]),
        # A number that was opened is opened.
        (
            [18, {"13": 0.4}, 5],
            [18, {"13": None}, 5],
            [18, {"13": 0.2}, {"8": 0.1}, 5],
            [18, {"13": None}, {"8": 0.1}, 5],
        ),
        # A step goes where it went.
        (
            [18, {"13": 0.4}, 5],
            [18, {"15": 0.3}, {"13": 0.4}, 5],
            [18, {"13": 0.2}, 5, 6],
            [18, {"15": 0.3}, {"13": 0.2}, 5, 6],
        ),
        ([1, 2, 3], [1, 2, 3, 6], [17, 1, 2, 3], [17, 1, 2, 3, 6]),
        # A step that was taken out is taken out.
        ([18, {"9": 0.1}, 5], [18, 5], [18, {"13": 0.3}, {"9": 0.4}, 5], [18, {"13": 0.3}, 5]),
        # There is nothing to change.
        ([18, {"13": 0.4}, 5], [18, {"13": 0.5}, 5], [1, 2, 3], None),
        ([18, {"9": 0.1}, 5], [18, 5], [17, 1], None),
        ([1, 2, 3], [1, {"7": 0.1}, 2, 3], [17, 5], None),
    ],
)
def test_another_flow_is_changed_alike(
    before: list[Any], after: list[Any], flow: list[Any], expected: list[Any] | None
) -> None:
    assert moved(before, after, flow) == expected
