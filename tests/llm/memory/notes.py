"""Notes for the tests, written out and drawn."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

import oag
from llm.memory_notes import KINDS, LONGEST_LESSON, Note, Trial
from oag.model.actions import flow_from_json
from oag.model.symbols import ParameterKind, parameter_kind

AJAR: list[Any] = [17, 1, 2, 3, {"19": [0.0, 0.5]}, 5]
CLOSED: list[Any] = [17, 1, 2, 3, {"19": [0.0, 0.86]}, 5]


def trial(task: str, seed: int | None, outcome: Any, revisions: int = 1) -> Trial:
    """Return a run of a correction."""
    return Trial(task=task, seed=seed, outcome=outcome, revisions=revisions)


TWICE = (trial("T1", 16999, "succeeded", 1), trial("T1", 17001, "succeeded", 1))
"""Evidence of a correction that is proven."""


def note(before: list[Any] = AJAR, after: list[Any] = CLOSED, **changes: Any) -> Note:
    """Return a note about a refrigerator that was left ajar, with some fields changed."""
    fields: dict[str, Any] = {
        "cause": "the joint limits end too early",
        "primitive": oag.Primitive.ARTICULATE_CLOSE,
        "kind": "close",
        "target": "refrigerator",
        "support": "",
        "before": flow_from_json(before),
        "after": flow_from_json(after),
        "lesson": "0.35 of the range was left open.",
        "evidence": (trial("T1", 17000, "succeeded", 1),),
    }
    return Note(**(fields | changes))


numbers = st.floats(0.01, 2.9).map(lambda value: round(value, 3))
limits = st.tuples(st.floats(0, 0.4), st.floats(0.5, 1)).map(lambda pair: (round(pair[0], 2), round(pair[1], 2)))
lines = st.text(st.characters(exclude_categories=("Cc", "Cf", "Cs")), min_size=1, max_size=120)


@st.composite
def actions(draw: st.DrawFn) -> oag.Action:
    """Draw an action whose number, if it takes one, is given or open."""
    primitive = draw(st.sampled_from(list(oag.Primitive)))
    kind = parameter_kind(primitive)
    if kind is ParameterKind.NONE:
        return oag.Action(primitive)
    given = limits if kind is ParameterKind.JOINT_LIMITS else numbers
    return oag.Action(primitive, draw(st.none() | given))


flows = st.lists(actions(), min_size=1, max_size=9).map(tuple)
evidence = st.builds(
    trial,
    lines,
    st.none() | st.integers(0, 2**31),
    st.sampled_from(["succeeded", "failed"]),
    st.integers(0, 5),
)
notes = st.builds(
    Note,
    cause=lines,
    primitive=st.sampled_from(list(oag.Primitive)),
    kind=st.sampled_from(KINDS),
    target=lines,
    support=st.just("") | lines,
    before=flows,
    after=flows,
    lesson=st.text(st.characters(exclude_categories=("Cc", "Cf", "Cs")), max_size=LONGEST_LESSON),
    evidence=st.lists(evidence, max_size=4).map(tuple),
)
