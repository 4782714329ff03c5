"""Which profile a text is written in, and that a text with mistakes says so when it was read in another one."""

from __future__ import annotations

import pytest

import bddl
from bddl.dialects import detect_dialect

BEHAVIOR = """(define (problem p-0)
    (:domain omnigibson)
    (:objects
        apple.n.01_1 - apple.n.01
    )
    (:init (inroom apple.n.01_1 kitchen))
    (:goal (cooked ?apple.n.01_1))
)
"""
LIBERO = "(define (problem p) (:domain robosuite) (:language put it there) (:objects a - cup) (:goal (and (on a b))))"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (BEHAVIOR, "behavior"),
        (BEHAVIOR.replace("omnigibson", "OmniGibson"), "behavior"),
        (BEHAVIOR.replace("omnigibson", "omnigibsn"), "behavior"),
        (BEHAVIOR.replace("omnigibson", "kitchen"), "scene"),
        (BEHAVIOR.replace("omnigibson", "omnigibsn").replace(".n.01", ""), "scene"),
        (BEHAVIOR.replace("(:domain", "; (:domain"), "scene"),
        (LIBERO, "libero"),
        (LIBERO.replace("robosuite", "robosuit"), "libero"),
        (LIBERO.replace("robosuite", "kitchen"), "scene"),
        ("", "scene"),
    ],
)
def test_domain_and_style_tell_the_dialect(text: str, expected: str) -> None:
    assert detect_dialect(text) == expected


@pytest.mark.parametrize("domain", ["omnigibson", "omnigibsn"])
def test_a_text_of_another_profile_says_which(domain: str) -> None:
    found = bddl.check(BEHAVIOR.replace("omnigibson", domain))
    first = found[0]
    assert (first.code, first.severity, first.line, first.column) == ("other-profile", "warning", 2, 14)
    assert first.message == "The text is written in the profile `behavior`, and it was read in the profile `scene`."
    assert first.hint == 'pass profile="behavior"'
    assert len(found) > 1 and found[1].severity == "error"
    with pytest.raises(bddl.BDDLError, match='pass profile="behavior"'):
        bddl.parse(BEHAVIOR)


def test_nothing_is_said_in_the_right_profile_or_of_a_legal_text() -> None:
    wrong = BEHAVIOR.replace("cooked", "cokked")
    for profile in ("behavior", "behavior-compat"):
        assert [item.code for item in bddl.check(wrong, profile)] == ["unknown-predicate"]
    assert bddl.check(BEHAVIOR.replace("?", "")) == ()
    own_words = wrong.replace(".n.01", "").replace("?", "")
    assert "other-profile" not in [item.code for item in bddl.check(own_words)]
    assert "other-profile" in [item.code for item in bddl.check(LIBERO, "behavior")]
