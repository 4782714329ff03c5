"""What is read in one pass is what the reader with messages reads, places and warnings included."""

from __future__ import annotations

import copy
import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
from bddl.dialects import PROFILES
from bddl.direct import read_directly
from bddl.parser import read_text
from tests.bddl.activity import ACTIVITY
from tests.bddl.strategies import OBJECTS, formulas, problems

SCENE = """; Two glasses.
(define (problem Tidy) (:domain kitchen)
    (:objects glass_0 glass_1 - glass Table-0 - table) ; (not an object)
    (:INIT (ontop glass_0 Table-0) (not (open fridge)))
    (:goal (and ; all of them
        (forall (?x - glass) (exists (?y - table) (imply (ontop ?x ?y) (or))))
        (forn (1) (?x - glass) (ontop ?x Table-0))
        (fornpairs (2) (?x - glass) (?y - table) (ontop ?x ?y))))
)
""".replace("fridge", "Table-0")


def places(formula: bddl.Formula) -> list[object]:
    """Return every place in a formula, and the classes of its nodes."""
    names = ("span", "word_spans", "variable_spans")
    return [(type(node), [getattr(node, name, None) for name in names]) for node in formula.walk()]


def compare(text: str, profile: str, objects: dict[str, str] | None = None) -> bool:
    """Compare both readers on a text, if the direct one reads it; True when it does."""
    direct = read_directly(text, "any", PROFILES[profile], objects)
    if direct is None:
        return False
    found, warnings = direct
    reading = read_text(text, "any", PROFILES[profile], objects)
    assert reading.found == found
    assert reading.reporter.diagnostics == warnings
    if isinstance(found, bddl.Problem):
        other = reading.found
        assert isinstance(other, bddl.Problem)
        assert (found.name, found.domain, found.span, found.warnings) == (
            other.name, other.domain, other.span, other.warnings,
        )  # fmt: skip
        assert [item.span for item in found.objects] == [item.span for item in other.objects]
        ours, theirs = (*found.init, found.goal), (*other.init, other.goal)
    else:
        assert not isinstance(reading.found, bddl.Problem | bddl.Domain | None)
        ours, theirs = (found,), (reading.found,)
    assert list(map(places, ours)) == list(map(places, theirs))
    return True


@pytest.mark.parametrize(
    ("text", "profile"),
    [
        (ACTIVITY, "behavior"),
        (ACTIVITY, "behavior-compat"),
        (ACTIVITY.upper(), "behavior"),
        (SCENE, "scene"),
        (SCENE.replace("\n", "\r\n"), "scene"),
        ("(NOT (open fridge_0))", "scene"),
        ("(and)", "scene"),
        ("(cooked ?apple.n.01_1)", "behavior"),
    ],
)
def test_correct_texts_are_read_directly(text: str, profile: str) -> None:
    assert compare(text, profile)


@given(problems(), st.sampled_from(sorted(PROFILES)))
def test_problems_are_read_alike(problem: bddl.Problem, profile: str) -> None:
    compare(bddl.format(problem), profile)


@given(formulas(), st.sampled_from(sorted(PROFILES)), st.booleans())
def test_formulas_are_read_alike(formula: bddl.Formula, profile: str, given_objects: bool) -> None:
    compare(bddl.format(formula), profile, OBJECTS if given_objects else None)


@given(
    st.sampled_from([(ACTIVITY, "behavior"), (ACTIVITY, "behavior-compat"), (SCENE, "scene")]),
    st.lists(st.tuples(st.floats(0, 1), st.integers(0, 3), st.sampled_from("() ?-_;:1aN*\n\t\ufeffé")), max_size=3),
)
def test_damaged_texts_are_read_alike(given_text: tuple[str, str], damages: list[tuple[float, int, str]]) -> None:
    text, profile = given_text
    for where, length, sign in damages:
        place = int(where * len(text))
        text = text[:place] + sign + text[place + length :]
    compare(text, profile)


@given(
    st.sampled_from([(ACTIVITY, "behavior"), (ACTIVITY, "behavior-compat"), (SCENE, "scene")]),
    st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=1, max_size=2),
)
def test_texts_with_exchanged_words_are_read_alike(
    given_text: tuple[str, str], swaps: list[tuple[float, float]]
) -> None:
    text, profile = given_text
    words = text.split(" ")
    for first, second in swaps:
        one, other = int(first * (len(words) - 1)), int(second * (len(words) - 1))
        words[one], words[other] = words[other], words[one]
    compare(" ".join(words), profile)


def test_what_has_no_places_yet_is_copied_with_them() -> None:
    problem = bddl.parse(SCENE)
    for again in (copy.deepcopy(problem), pickle.loads(pickle.dumps(problem))):
        assert again == problem and again.span == problem.span
        assert places(again.goal) == places(problem.goal)
        assert again.objects[1].span == problem.objects[1].span
    with pytest.raises(AttributeError, match="'Atom' object has no attribute 'colour'"):
        _ = bddl.Atom("open", ("a",)).colour  # type: ignore[attr-defined]


@pytest.mark.parametrize("text", [f"{'(not ' * 200}(open a){')' * 200}", "(open é)", "(open a) (open b)", "", "(", ")"])
def test_unusual_texts_are_left_to_the_other_reader(text: str) -> None:
    assert read_directly(text, "any", PROFILES["scene"], None) is None
