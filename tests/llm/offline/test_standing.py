"""Wishes to stand things up: how people say them, and what is refused with the true reason."""

from __future__ import annotations

import math

import pytest

import bddl
import llm
import oag
from llm.errors import QueryError

LYING = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
_BOXES = {
    "bottle_0": ("bottle", (0.065, 0.065, 0.22)),
    "glass_0": ("water_glass", (0.07, 0.07, 0.12)),
    "glass_1": ("water_glass", (0.07, 0.07, 0.12)),
    "can_0": ("can", (0.06, 0.06, 0.11)),
    "ball_0": ("tennis_ball", (0.065, 0.065, 0.065)),
    "table_0": ("table", (0.7, 1.0, 0.7)),
    "counter_0": ("countertop", (0.6, 1.0, 0.9)),
}
_STANDS = ("bottle_0", "glass_0", "glass_1", "can_0")


def scene(*fallen: str) -> oag.Scene:
    """Return a scene of things on a table, some of which have fallen over."""
    objects = {
        key: {
            "category": category,
            "position": [1.0, 0.2 * number, 0.35],
            "orientation": list(LYING if key in fallen else (1.0, 0.0, 0.0, 0.0)),
            "bbox_extent": list(box),
        }
        for number, (key, (category, box)) in enumerate(_BOXES.items())
    }
    facts = [f"(ontop {key} table_0)" for key in (*_STANDS, "ball_0")]
    closed = ["ontop", "inside", "open"]
    for key in _STANDS if fallen else ():
        facts += [f"(can_stand {key})", f"(not (upright {key}))" if key in fallen else f"(upright {key})"]
        closed = ["ontop", "inside", "open", "can_stand", "upright"]
    domain = oag.Domain.fallen() if fallen else oag.Domain("household")
    return oag.Scene.from_json({"name": "home", "objects": objects, "facts": facts, "closed": closed}, domain)


FALLEN, ALL_STAND = scene("bottle_0", "glass_1"), scene()
BOTTLE = "(and (ontop bottle_0 table_0) (upright bottle_0))"
GLASS = "(and (ontop glass_1 table_0) (upright glass_1))"


@pytest.mark.parametrize(
    ("query", "wanted"),
    [
        ("stand the bottle up", BOTTLE),
        ("stand up the bottle", BOTTLE),
        ("Please stand the bottle on the table up again.", BOTTLE),
        ("stand the bottle upright", BOTTLE),
        ("put the bottle upright", BOTTLE),
        ("put the bottle back on its feet", BOTTLE),
        ("set the bottle lying on its side upright", BOTTLE),
        ("turn the bottle upright", BOTTLE),
        ("pick up the bottle that has fallen over and put it upright", BOTTLE),
        ("stand up bottle_0", BOTTLE),
        ("set the fallen glass upright", GLASS),
        ("stand the glass up", GLASS),  # The one that lies.
        ("stand everything up", f"(and {BOTTLE} {GLASS})"),
        ("stand the bottle and the glass up", f"(and {BOTTLE} {GLASS})"),
        ("put the can onto the counter and stand the bottle up", f"(and (ontop can_0 counter_0) {BOTTLE})"),
        ("stand the bottle up and put it onto the counter", "(and (ontop bottle_0 counter_0) (upright bottle_0))"),
        # Another place is a wish to put it there, as it always was.
        ("stand the bottle on the counter", "(ontop bottle_0 counter_0)"),
        ("put the bottle upright on the counter", "(ontop bottle_0 counter_0)"),
    ],
)
def test_a_wish_to_stand_something_up_is_read_and_proved(query: str, wanted: str) -> None:
    task = llm.propose(query, FALLEN).task
    assert bddl.equivalent(task.goal, FALLEN.domain.formula(wanted), FALLEN.categories)
    assert oag.compose(task).verify().verdict is oag.Verdict.PROVED


def test_it_is_picked_up_and_set_upright_where_it_lay() -> None:
    pick, put = llm.propose("stand the bottle up", FALLEN).task.subtasks
    assert (pick.target, pick.support_init, put.support_goal) == ("bottle_0", "table_0", "table_0")
    assert [action.primitive.name for action in put.flow or ()][-3:] == ["SET_UPRIGHT", "UNGRASP", "RETREAT"]


@pytest.mark.parametrize(
    ("query", "code", "words"),
    [
        ("stand the can up", "already-so", "can_0 stands upright already; there is nothing to do"),
        ("put the can upright", "already-so", "can_0 stands upright already"),
        ("stand the ball up", "affordance", "ball_0 (tennis_ball) has no side on which alone it stands"),
        ("stand the table up", "affordance", "table_0 is a fixture"),
        ("lay the bottle down", "missing-place", "where to put bottle_0"),
        ("lay the can on its side", "unknown-action", "nothing here turns a thing over"),
        ("turn the can upside down", "unknown-action", "no action of the library"),
        ("stand the lamp up", "unknown-object", "lamp"),
    ],
)
@pytest.mark.parametrize("here", [FALLEN, ALL_STAND], ids=["fallen", "all stand"])
def test_what_cannot_be_stood_up_is_refused_with_the_reason(here: oag.Scene, query: str, code: str, words: str) -> None:
    with pytest.raises(QueryError) as found:
        llm.propose(query, here)
    assert found.value.code == code and words in str(found.value)


def test_where_all_stands_a_bottle_does_so_already() -> None:
    with pytest.raises(QueryError, match="bottle_0 stands upright already; there is nothing to do"):
        llm.propose("stand the bottle up", ALL_STAND)


def test_what_a_refusal_suggests_can_be_planned() -> None:
    with pytest.raises(QueryError) as found:
        llm.propose("do something with the bottle", FALLEN)
    suggested = found.value.suggestions
    assert suggested and all(llm.propose(sentence, FALLEN).task for sentence in suggested)
