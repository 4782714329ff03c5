"""What the analyser finds in problems in the style of BEHAVIOR, and what it leaves alone."""

from __future__ import annotations

import builtins
from collections.abc import Iterable
from dataclasses import replace

import pytest

import bddl
from bddl.diagnostics import MOST_LISTED

START = """(define (problem serving_apples-0)
    (:domain omnigibson)
    (:objects
        apple.n.01_1 apple.n.01_2 apple.n.01_3 - apple.n.01
        plate.n.04_1 plate.n.04_2 - plate.n.04
        stain.n.01_1 - stain.n.01
        table.n.02_1 - table.n.02
        floor.n.01_1 - floor.n.01
        agent.n.01_1 - agent.n.01
    )
    (:init
        (ontop apple.n.01_1 floor.n.01_1)
        (ontop apple.n.01_2 floor.n.01_1)
        (ontop apple.n.01_3 floor.n.01_1)
        (ontop plate.n.04_1 table.n.02_1)
        (ontop plate.n.04_2 table.n.02_1)
        (covered plate.n.04_1 stain.n.01_1)
        (inroom table.n.02_1 kitchen)
        (inroom floor.n.01_1 kitchen)
        (ontop agent.n.01_1 floor.n.01_1)
        {more}
    )
    (:goal
        {goal}
    )
)
"""
ALL_ON_TABLE = "(forall (?apple.n.01 - apple.n.01) (ontop ?apple.n.01 ?table.n.02_1))"


def activity(goal: str = ALL_ON_TABLE, more: str = "") -> str:
    return START.format(goal=goal, more=more)


def codes(found: Iterable[bddl.Diagnostic]) -> list[str]:
    return [item.code for item in found]


def test_a_sound_activity_has_no_findings() -> None:
    assert bddl.analyse(activity(), "behavior") == ()


@pytest.mark.parametrize(
    ("goal", "expected"),
    [
        (
            "(forall (?apple.n.01 - apple.n.01) (ontop ?apple.n.01_1 ?table.n.02_1))",
            {"unused-variable"},
        ),
        (
            "(forpairs (?apple.n.01 - apple.n.01) (?plate.n.04 - plate.n.04) (ontop ?apple.n.01 ?table.n.02_1))",
            {"unused-variable"},
        ),
        (
            "(forall (?apple.n.01 - apple.n.01) (exists (?apple.n.01 - apple.n.01) (ontop ?apple.n.01 ?table.n.02_1)))",
            {"shadowed-variable"},
        ),
        (
            "(forpairs (?apple.n.01 - apple.n.01) (?apple.n.01 - plate.n.04) (ontop ?apple.n.01 ?floor.n.01_1))",
            {"shadowed-variable"},
        ),
        (
            "(exists (?apple.n.01 - apple.n.01) (nextto ?apple.n.01 ?apple.n.01_1))",
            {"mixed-instance", "reflexive-atom"},
        ),
        ("(nextto ?apple.n.01_1 ?apple.n.01_1)", {"reflexive-atom"}),
        ("(forn (4) (?apple.n.01 - apple.n.01) (ontop ?apple.n.01 ?table.n.02_1))", {"impossible-goal"}),
        ("(and (ontop ?apple.n.01_1 ?table.n.02_1) (not (ontop ?apple.n.01_1 ?table.n.02_1)))", {"impossible-goal"}),
        ("(not (covered ?apple.n.01_1 ?stain.n.01_1))", {"goal-holds-at-start"}),
        ("(and)", {"goal-holds-at-start"}),
        ("(ontop ?table.n.02_1 ?apple.n.01_1)", {"swapped-roles"}),
        ("(covered ?stain.n.01_1 ?plate.n.04_1)", {"swapped-roles"}),
        ("(forpairs (?table.n.02 - table.n.02) (?table.n.02_b - table.n.02) (nextto ?table.n.02 ?table.n.02_b))",
         {"empty-range", "impossible-goal"}),
        # What looks alike and is meant: nothing is found.
        ("(forn (2) (?apple.n.01 - apple.n.01) (ontop ?apple.n.01 ?table.n.02_1))", set()),
        ("(forpairs (?apple.n.01 - apple.n.01) (?plate.n.04 - plate.n.04) (ontop ?apple.n.01 ?plate.n.04))", set()),
        ("(not (covered ?plate.n.04_1 ?stain.n.01_1))", set()),
        ("(ontop ?plate.n.04_1 ?plate.n.04_2)", set()),
        ("(imply (ontop ?apple.n.01_1 ?floor.n.01_1) (ontop ?apple.n.01_2 ?table.n.02_1))", set()),
    ],
)  # fmt: skip
def test_goals(goal: str, expected: set[str]) -> None:
    assert set(codes(bddl.analyse(activity(goal), "behavior-compat"))) == expected


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ("(ontop apple.n.01_1 floor.n.01_1)", ["repeated-literal"]),
        ("(not (covered plate.n.04_1 stain.n.01_1))", ["contradictory-init"]),
        ("(not (cooked apple.n.01_1)) (not (cooked apple.n.01_1))", ["repeated-literal"]),
        ("(not (cooked apple.n.01_1))", []),
        ("(ontop apple.n.01_1 apple.n.01_1)", ["reflexive-atom"]),
    ],
)
def test_starts(more: str, expected: list[str]) -> None:
    assert codes(bddl.analyse(activity(more=more), "behavior-compat")) == expected


@pytest.mark.parametrize(
    ("goal", "expected"),
    [
        ("(open box_0)", ["future-without-real"]),
        ("(real juice_0)", []),
        ("(contains box_0 juice_0)", []),
        ("(exists (?x - juice) (contains box_0 ?x))", []),
    ],
)
def test_a_goal_may_ask_for_a_future_object_in_any_way(goal: str, expected: list[str]) -> None:
    more = {name: bddl.PROFILES["behavior"].predicates[name] for name in ("future", "real")}
    profile = replace(bddl.PROFILES["scene"], predicates={**bddl.PREDICATES, **more})
    text = "(define (problem p) (:domain d) (:objects juice_0 - juice box_0 - box) (:init (future juice_0) (hot box_0))"
    assert codes(bddl.analyse(f"{text} (:goal {goal}))", profile)) == expected


def test_objects_of_which_nothing_is_said() -> None:
    text = "(define (problem p) (:domain d) (:objects a_0 b_0 - a) (:init {}) (:goal (nextto a_0 b_0)))"
    assert codes(bddl.analyse(text.format("(open a_0)"))) == ["unmentioned-object"]
    assert codes(bddl.analyse(text.format("(open a_0) (open b_0)"))) == []
    # A variable is no object, whatever it is called.
    shadowing = text.replace("(nextto a_0 b_0)", "(and (open a_0) (exists (?b_0 - a) (nextto a_0 ?b_0)))")
    assert "unmentioned-object" not in codes(bddl.analyse(shadowing.format("(open a_0)")))
    # A start that says nothing at all is somewhere else, such as in a scene file.
    assert codes(bddl.analyse(text.format(""))) == []


def test_the_filled_contain_and_what_is_not_future_is_real() -> None:
    objects = "(:objects b.n.01_1 b.n.01_2 - b.n.01 w.n.01_1 - w.n.01)"
    text = f"(define (problem p) (:domain omnigibson) {objects} (:init (filled b.n.01_1 w.n.01_1) {{}}) (:goal {{}}))"
    held = text.format("(inroom b.n.01_1 kitchen)", "(and (contains ?b.n.01_1 ?w.n.01_1) (real ?b.n.01_1))")
    future = text.format("(future b.n.01_2)", "(and (contains ?b.n.01_1 ?w.n.01_1) (real ?b.n.01_2))")
    assert codes(bddl.analyse(held, "behavior")) == ["goal-holds-at-start", "idle-real"]
    assert codes(bddl.analyse(future, "behavior")) == []


def test_a_conjunct_that_the_reference_drops_is_named() -> None:
    goal = f"{ALL_ON_TABLE}\n        (not (open ?table.n.02_1))"
    (strict,) = bddl.analyse(activity(goal), "behavior")
    assert (strict.code, strict.severity, strict.line) == ("several-formulas", "error", 25)
    (tolerant,) = bddl.analyse(activity(goal), "behavior-compat")
    assert (tolerant.code, tolerant.severity, tolerant.line) == ("several-formulas", "warning", 25)


def test_the_conjuncts_that_clash_are_told_and_no_others() -> None:
    goal = f"""(and
            (covered ?plate.n.04_2 ?stain.n.01_1)
            {ALL_ON_TABLE}
            (open ?table.n.02_1)
            (forn (1) (?apple.n.01 - apple.n.01) (ontop ?apple.n.01 ?table.n.02_1))
        )"""
    (found,) = bddl.analyse(activity(goal), "behavior")
    assert (found.code, found.severity) == ("impossible-goal", "error")
    assert "2 of its 4 conjuncts, at 26:13, 28:13, cannot hold together" in found.message


@pytest.mark.parametrize(
    ("goal", "hint"),
    [
        ("(and (open ?b.n.01_1) (not (open ?b.n.01_1)))",
         "remove what contradicts the rest, or join alternatives with or"),
        ("(and (open ?b.n.01_1) (or))", "(or) is never true: write what may hold instead"),
        ("(forn (4) (?b.n.01 - b.n.01) (open ?b.n.01))",
         "remember that forn counts exactly, and that a quantifier speaks of every object of its category"),
        ("(and (open ?b.n.01_1) (forall (?b.n.01 - b.n.01) (not (open ?b.n.01))))",
         "remember that a quantifier speaks of every object of its category"),
        ("(fornpairs (3) (?b.n.01 - b.n.01) (?w.n.01 - w.n.01) (nextto ?b.n.01 ?w.n.01))",
         "remember that no object is paired with itself, or twice"),
    ],
)  # fmt: skip
def test_the_hint_about_an_impossible_goal_speaks_of_the_forms_that_are_there(goal: str, hint: str) -> None:
    text = "(define (problem p) (:domain omnigibson) (:objects b.n.01_1 b.n.01_2 - b.n.01 w.n.01_1 - w.n.01) (:init "
    text += f"(inroom b.n.01_1 kitchen) (inroom b.n.01_2 kitchen) (inroom w.n.01_1 kitchen)) (:goal {goal}))"
    (found,) = [item for item in bddl.analyse(text, "behavior-compat") if item.code == "impossible-goal"]
    assert found.hint == hint


def test_findings_come_in_the_order_of_their_places() -> None:
    goal = "(and (nextto ?apple.n.01_1 ?apple.n.01_1) (ontop ?table.n.02_1 ?plate.n.04_1))"
    found = bddl.analyse(activity(goal, more="(ontop apple.n.01_1 floor.n.01_1)"), "behavior")
    assert codes(found) == ["repeated-literal", "reflexive-atom", "swapped-roles"]
    assert [(item.line, item.column) for item in found] == sorted((item.line, item.column) for item in found)


def test_a_text_that_cannot_be_read_yields_what_check_yields() -> None:
    text = activity("(on ?apple.n.01_1 ?table.n.02_1)")
    assert bddl.analyse(text, "behavior") == bddl.check(text, "behavior") != ()


def test_a_tree_is_examined_like_its_print() -> None:
    problem = bddl.parse(activity("(nextto ?apple.n.01_1 ?apple.n.01_1)"), "behavior")
    assert codes(bddl.analyse(problem, "behavior")) == ["reflexive-atom"]
    formula = bddl.parse_formula("(ontop table_0 glass_0)")
    assert codes(bddl.analyse(formula)) == ["swapped-roles"]


def test_without_z3_the_question_stays_open_and_the_note_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = builtins.__import__

    def without_z3(name: str, *rest: object) -> object:
        if name == "z3":
            raise ImportError("No module named 'z3'")
        return genuine(name, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", without_z3)
    goal = "(forn (4) (?apple.n.01 - apple.n.01) (ontop ?apple.n.01 ?table.n.02_1))"
    (found,) = bddl.analyse(activity(goal), "behavior")
    assert (found.code, found.severity) == ("unchecked-goal", "note")
    assert "z3 is not installed" in found.message and "pip install" in found.hint
    # Where a state that satisfies the goal is easily guessed, nothing has to be proved.
    assert bddl.analyse(activity(), "behavior") == ()


def test_a_goal_too_large_to_spell_out_is_not_spelt_out() -> None:
    nested = "(ontop ?a ?b)"
    for name in "abcdefgh":
        nested = f"(exists (?{name} - cup) {nested})"
    cups = " ".join(f"cup_{index}" for index in range(40))
    text = f"(define (problem p) (:domain d) (:objects {cups} - cup) (:goal {nested}))"
    for prove in (True, False):
        (note,) = [item for item in bddl.analyse(text, prove=prove) if item.code == "unchecked-goal"]
        assert note.message == (
            "It was not examined whether the goal holds at the start, or in any state at all: it spells out to more "
            "than 20000 atoms."
        )


@pytest.mark.parametrize("depth", [10_000])
@pytest.mark.slow
def test_depth_is_no_obstacle(depth: int) -> None:
    deep = "(not " * depth + "(open a_0)" + ")" * depth
    text = f"(define (problem p) (:domain d) (:objects a_0 - a) (:init (open a_0)) (:goal {deep}))"
    assert codes(bddl.analyse(text)) == ["goal-holds-at-start"]
    nested = "".join(f"(exists (?v{index} - a) " for index in range(depth)) + "(open a_0)" + ")" * depth
    found = bddl.analyse(nested, objects={"a_0": "a"}, prove=False)
    assert codes(found).count("unused-variable") == min(depth, MOST_LISTED)


WILD = START.replace("table.n.02_1 - table", "table.n.02_1 table.n.02_* - table").replace(
    "(inroom table.n.02_1 kitchen)", "(inroom table.n.02_1 kitchen) (inroom table.n.02_* kitchen)"
)
ONLY_WILD = START.replace("table.n.02_1 - table", "table.n.02_* - table").replace("table.n.02_1", "table.n.02_*")


def wildcards(goal: str, text: str = WILD) -> list[tuple[str, str]]:
    """Return severity and message of what is found about wildcards."""
    if text is ONLY_WILD:
        text = text.replace("ontop plate.n.04_1 table.n.02_*", "ontop plate.n.04_1 floor.n.01_1")
        text = text.replace("ontop plate.n.04_2 table.n.02_*", "ontop plate.n.04_2 floor.n.01_1")
    found = bddl.analyse(text.format(goal=goal, more=""), "behavior")
    assert all(item.severity != "error" for item in found), found
    return [(item.severity, item.message) for item in found if item.code == "counted-wildcard"]


SOME_TABLE = "(exists (?table.n.02 - table.n.02) (ontop ?apple.n.01_1 ?table.n.02))"


def test_a_goal_over_a_category_with_a_wildcard_has_one_note() -> None:
    ((severity, message),) = wildcards(f"(and {SOME_TABLE} {SOME_TABLE.replace('01_1', '01_2')})")
    assert severity == "note" and message.startswith("`table.n.02_*` is counted as one object")
    assert wildcards("(ontop ?apple.n.01_1 ?table.n.02_1)") == []
    assert wildcards(ALL_ON_TABLE) == []


def test_a_goal_over_a_wildcard_alone_is_suspicious() -> None:
    ((severity, message),) = wildcards(SOME_TABLE, ONLY_WILD)
    assert severity == "warning" and "`table.n.02` has no other" in message


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        ("(forpairs (?apple.n.01 - apple.n.01) (?table.n.02 - table.n.02) {})", "only 2 pairs are asked for"),
        ("(forpairs (?table.n.02 - table.n.02) (?apple.n.01 - apple.n.01) {})", "asks for up to 3"),
        ("(fornpairs (3) (?apple.n.01 - apple.n.01) (?table.n.02 - table.n.02) {})", "3 pairs of 2 are asked for"),
        ("(exists (?apple.n.01 - apple.n.01) (forn (3) (?table.n.02 - table.n.02) {}))", "3 of 2 are to be so"),
    ],
)
def test_a_goal_that_counts_a_wildcard_is_suspicious(goal: str, said: str) -> None:
    """How many there are decides what it asks for, and whether that is possible at all."""
    ((severity, message),) = wildcards(goal.format("(ontop ?apple.n.01 ?table.n.02)"))
    assert severity == "warning" and said in message


def test_a_goal_that_contradicts_itself_beside_a_wildcard_is_impossible() -> None:
    goal = f"(and {SOME_TABLE} (open ?plate.n.04_1) (not (open ?plate.n.04_1)))"
    found = bddl.analyse(WILD.format(goal=goal, more=""), "behavior")
    assert "2 of its 3 conjuncts" in next(item.message for item in found if item.code == "impossible-goal")


def test_whether_a_goal_about_a_wildcard_holds_at_the_start_is_not_examined() -> None:
    goal = "(forall (?table.n.02 - table.n.02) (not (frozen ?table.n.02)))"
    (first, *_) = bddl.analyse(WILD.format(goal=goal, more=""), "behavior")
    assert (first.code, first.severity) == ("unchecked-goal", "note")


COMING = "(future apple.n.01_1)"


def misused(goal: str, more: str = COMING, placed: bool = False) -> list[tuple[str, str]]:
    """Return codes and severities of what is found about things that are yet to come."""
    text = activity(goal, more)
    text = text if placed else text.replace("(ontop apple.n.01_1 floor.n.01_1)", "")
    return [(item.code, item.severity) for item in bddl.analyse(text, "behavior")]


def test_what_is_yet_to_come_stands_nowhere() -> None:
    real = "(real ?apple.n.01_1)"
    assert misused(real) == []
    assert misused(real, placed=True) == [("described-future", "error")]
    for said in ("(frozen apple.n.01_1)", "(ontop plate.n.04_1 apple.n.01_1)", "(inroom apple.n.01_1 kitchen)"):
        assert misused(real, f"{COMING} {said}") == [("described-future", "error")]
    assert misused(real, f"{COMING} (not (frozen apple.n.01_1))") == []
    assert misused("(real ?stain.n.01_1)", "(future stain.n.01_1) (insource floor.n.01_1 stain.n.01_1)", True) == [
        ("described-future", "error")  # A plate is covered with it.
    ]


def test_a_goal_about_what_is_yet_to_come_asks_that_it_come() -> None:
    assert misused("(frozen ?apple.n.01_1)") == [("future-without-real", "error")]
    assert misused("(and (frozen ?apple.n.01_1) (not (real ?apple.n.01_1)))") == [("future-without-real", "error")]
    assert misused("(and (frozen ?apple.n.01_1) (real ?apple.n.01_1))") == []
    assert misused("(forn (1) (?apple.n.01 - apple.n.01) (real ?apple.n.01))") == []


@pytest.mark.parametrize(
    "goal",
    [
        "(real ?plate.n.04_1)",
        "(forall (?plate.n.04 - plate.n.04) (real ?plate.n.04))",
        "(imply (real ?apple.n.01_1) (real ?plate.n.04_1))",
    ],
)
def test_to_ask_for_what_is_there_from_the_start_is_idle(goal: str) -> None:
    whole = f"(and (real ?apple.n.01_1) (open ?plate.n.04_2) {goal})"
    assert misused(whole) == [("idle-real", "warning")]


def test_what_is_there_may_be_used_up() -> None:
    assert misused("(and (real ?apple.n.01_1) (not (real ?plate.n.04_1)))") == []
