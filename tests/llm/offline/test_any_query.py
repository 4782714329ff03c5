"""Whatever is asked: a proposal that is proved, or a refusal; never another exception, never a wrong plan."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import llm
import oag
from llm.offline.lexicon import built_in
from tests.llm.kitchens import SCENES

KNOWN_COMPLETELY = tuple(scene for scene in SCENES.values() if scene.closed)
WORDS = (
    *built_in().terminals,
    "glass",
    "fridge",
    "apple_0",
    "bowl",
    "table",
    "cabinet",
    "quux",
    "'s",
    ",",
    ".",
    "please",
)
SENTENCES = st.lists(st.sampled_from(WORDS), max_size=9).map(" ".join)
VERBS = st.sampled_from(["put", "take", "move", "pick up", "open", "close", "lift", "the glass"])
NAMES = st.sampled_from(["glass", "cup", "fridge", "apple", "bowl", "table", "counter", "cabinet", "glass_1", "banana"])
LINKS = st.sampled_from(["into", "on", "in", "to", "from", "off", "onto", "next to", "and", "of", "then"])
NEAR_SENTENCES = st.builds(
    lambda verb, first, rest: " ".join([verb, "the", first, *(f"{link} the {name}" for link, name in rest)]),
    VERBS,
    NAMES,
    st.lists(st.tuples(LINKS, NAMES), max_size=4),
)
THINGS = st.sampled_from(
    ["the glass", "the cup", "both glasses", "the apple and the bowl", "everything", "everything on the table", "it",
     "them", "both", "all the fruit", "the left glass", "the cup next to the apple", "the milk", "the banana",
     "the table",
     "everything in the fridge", "the contents of the cabinet", "the plate", "the fridge", "the fridge and the cabinet"]
)  # fmt: skip
PLACES = st.sampled_from(
    ["in the fridge", "into it", "there", "inside", "on the table", "to the cabinet", "in them", "in the bowl", "",
     "out",
     "from the fridge", "out of it", "on it", "from them", "from the table to the fridge", "in there", "on the plate"]
)  # fmt: skip
CLAUSES = st.builds(
    lambda verb, things, place: f"{verb} {things} {place}".strip(),
    st.sampled_from(
        ["put", "take", "pick up", "open", "close", "clear", "empty", "go to", "move", "fill", "tidy", "get"]
    ),
    THINGS,
    PLACES,
)
STORIES = st.lists(st.tuples(CLAUSES, st.sampled_from([", then ", " and ", ". ", ", "])), min_size=1, max_size=4).map(
    lambda parts: "".join(clause + link for clause, link in parts)
)


@given(st.one_of(SENTENCES, NEAR_SENTENCES, STORIES, st.text(max_size=40)), st.sampled_from(KNOWN_COMPLETELY))
@example("'s", KNOWN_COMPLETELY[0])
@example("put \u0130 into \ud800", KNOWN_COMPLETELY[0])
def test_any_query_is_proved_or_refused(query: str, scene: oag.Scene) -> None:
    try:
        proposal = llm.propose(query, scene)
    except llm.QueryError as error:
        assert str(error).startswith("cannot plan")
        return
    report = oag.compose(proposal.task).verify()
    assert report.verdict is oag.Verdict.PROVED, str(report)


@pytest.mark.slow
@given(st.one_of(NEAR_SENTENCES, STORIES), st.sampled_from(KNOWN_COMPLETELY))
@example("put everything in the fridge, then take the glass in the fridge, then ", KNOWN_COMPLETELY[0])
@example("put everything in the fridge, then take the glass in the fridge, then ", KNOWN_COMPLETELY[1])
def test_a_refusal_suggests_only_what_works(query: str, scene: oag.Scene) -> None:
    try:
        llm.propose(query, scene)
    except llm.QueryError as error:
        for suggestion in error.suggestions:
            assert llm.propose(suggestion, scene).expanded.task_name == suggestion
