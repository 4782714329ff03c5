"""Whatever is asked: a proposal that is proved, or a refusal; never another exception, never a wrong plan."""

from __future__ import annotations

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


@given(st.one_of(SENTENCES, NEAR_SENTENCES, st.text(max_size=40)), st.sampled_from(KNOWN_COMPLETELY))
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


@given(NEAR_SENTENCES, st.sampled_from(KNOWN_COMPLETELY))
def test_a_refusal_suggests_only_what_works(query: str, scene: oag.Scene) -> None:
    try:
        llm.propose(query, scene)
    except llm.QueryError as error:
        for suggestion in error.suggestions:
            assert llm.propose(suggestion, scene).expanded.task_name == suggestion
