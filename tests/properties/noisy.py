"""Random plans with mistakes of wording: subtasks said again, cut in two, joined, or preceded by a drive."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import strategies as st

from tests.bruteforce import Part
from tests.properties.plans import Case, cases


@st.composite
def noisy_cases(draw: st.DrawFn, most_unknown: int = 4, rounds: int = 1) -> Case:
    """A random plan with one to three mistakes in each of some rounds."""
    case = draw(cases(most_unknown=most_unknown))
    parts = list(case.parts)
    for _ in range(rounds):
        for _ in range(draw(st.integers(1, 3))):
            _reword(draw, parts)
    return replace(case, parts=tuple(parts))


def _reword(draw: st.DrawFn, parts: list[Part]) -> None:
    """Make one mistake in a plan."""
    at = draw(st.integers(0, len(parts) - 1))
    part = parts[at]
    change = draw(st.sampled_from(("again", "again", "later", "cut", "cut", "join", "drive")))
    if change == "again":
        parts.insert(at + 1, part)
    elif change == "later":
        parts.insert(draw(st.integers(at + 1, len(parts))), part)
    elif change == "cut" and len(part.flow) > 1:
        cut = draw(st.integers(1, len(part.flow) - 1))
        between = draw(st.sampled_from(((), part.init[:1], part.goal[:1])))
        if all(fact[0] == "open" or fact[2] == "gripper" or not wanted for fact, wanted in between):
            first = replace(part, goal=between, flow=part.flow[:cut])
            second = replace(part, init=draw(st.sampled_from(((), between))), flow=part.flow[cut:])
            parts[at : at + 1] = [first, second]
    elif change == "join" and at + 1 < len(parts) and parts[at + 1].target == part.target:
        following = parts[at + 1]
        support = following.support or part.support
        parts[at : at + 2] = [replace(following, init=part.init, support=support, flow=part.flow + following.flow)]
    elif change == "drive":
        parts.insert(at, Part(draw(st.sampled_from(("table_0", part.target))), None, (), (), (17,)))
