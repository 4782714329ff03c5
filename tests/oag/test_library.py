"""The table of primitives, row by row, as docs/semantics.md has it."""

from __future__ import annotations

import pytest

import bddl
from oag.model.symbols import Condition, Fact, Value, condition_of
from oag.model.symbols import Primitive as P
from oag.primitives.table import Context, Placement, effect, library_sha, needed, placement_of, requirements

GLASS = Context("glass_0", "fridge_0", Placement("inside", "fridge_0"), True, ("fridge_0",))
ON_TABLE = Context("glass_0", "table_0", Placement("ontop", "table_0"), True, ("fridge_0",))
PICK = Context("glass_0", None, None, True, ("fridge_0",), ("bowl_0",))
DOOR = Context("fridge_0", None, None, False, ("fridge_0",))
HELD = "holding glass_0"
CARRIED: dict[Fact, Value] = {
    ("ontop", "glass_0", "*"): False,
    ("inside", "glass_0", "*"): False,
    ("nextto", "glass_0", "*"): None,
    ("nextto", "*", "glass_0"): None,
    ("touching", "glass_0", "*"): None,
    ("touching", "*", "glass_0"): None,
    ("under", "glass_0", "*"): None,
    ("under", "*", "glass_0"): None,
}


# A motion of the hand takes a thing out of a bowl, and out of nothing else.
MOVED: dict[Fact, Value] = {
    **{fact: value for fact, value in CARRIED.items() if fact[0] != "inside"},
    ("inside", "glass_0", "bowl_0"): False,
}


@pytest.mark.parametrize(
    ("primitive", "context", "hand", "texts"),
    [
        (P.APPROACH, PICK, "empty", ["near(glass_0)"]),
        (P.CONVERGE, PICK, "empty", ["eef(before glass_0)"]),
        (
            P.GRASP,
            PICK,
            "empty",
            ["eef(at glass_0)", "handempty", "not inside(glass_0, fridge_0) or open(fridge_0)"],
        ),
        (P.GRASP, DOOR, "empty", ["eef(at fridge_0)", "handempty"]),
        (P.ARTICULATE_OPEN, DOOR, "empty", ["gripping(fridge_0)"]),
        (P.ARTICULATE_CLOSE, DOOR, "empty", ["gripping(fridge_0)"]),
        (P.UNGRASP, GLASS, HELD, ["near(fridge_0)", "open(fridge_0)"]),
        (P.UNGRASP, ON_TABLE, HELD, ["near(table_0)"]),
        (P.UNGRASP, GLASS, "holding apple_0", ["not inside(apple_0, gripper)"]),
        (P.UNGRASP, DOOR, "holding apple_0", ["not inside(apple_0, gripper)"]),
        (P.UNGRASP, PICK, "gripping fridge_0", []),
        (P.UNGRASP, PICK, None, ["handempty or inside(glass_0, gripper) or gripping(glass_0) or gripping(fridge_0)"]),
        (P.UNGRASP, PICK, HELD, []),
        (P.RETREAT, PICK, HELD, []),
        (P.LIFT_EEF_UP, PICK, HELD, []),
        (P.NAVIGATE_TO_TARGET, PICK, HELD, []),
        (P.MOVE_BASE_LEFT, PICK, HELD, []),
    ],
)
def test_preconditions(primitive: P, context: Context, hand: str, texts: list[str]) -> None:
    clauses = requirements(primitive, context, hand)
    assert [" or ".join(condition.text() for condition in clause) for clause in clauses] == texts


@pytest.mark.parametrize(
    ("primitive", "context", "hand", "written"),
    [
        (P.APPROACH, PICK, "empty", {("eef",): "before glass_0"}),
        (P.CONVERGE, PICK, "empty", {("eef",): "at glass_0"}),
        (P.GRASP, PICK, "empty", {("hand",): HELD}),
        (P.GRASP, DOOR, "empty", {("hand",): "gripping fridge_0"}),
        (P.ARTICULATE_OPEN, DOOR, "gripping fridge_0", {("open", "fridge_0"): True}),
        (P.ARTICULATE_CLOSE, DOOR, "gripping fridge_0", {("open", "fridge_0"): False}),
        (
            P.UNGRASP,
            GLASS,
            HELD,
            {
                ("hand",): "empty",
                ("inside", "glass_0", "fridge_0"): True,
                ("inside", "fridge_0", "glass_0"): False,
            },
        ),
        (P.UNGRASP, GLASS, "holding apple_0", {("hand",): "empty"}),
        (P.UNGRASP, PICK, HELD, {("hand",): "empty"}),
        (P.UNGRASP, GLASS, None, {("hand",): "empty", ("ontop", "*", "*"): None, ("inside", "*", "*"): None}),
        (P.RETREAT, PICK, "empty", {("eef",): "home"}),
        (P.RETREAT, PICK, HELD, {("eef",): "home", **CARRIED}),
        (P.RETREAT, PICK, "gripping fridge_0", {("eef",): "home"}),
        (P.APPROACH, PICK, HELD, {("eef",): "before glass_0", **MOVED}),
        (P.CONVERGE, PICK, HELD, {("eef",): "at glass_0", **MOVED}),
        (P.LIFT_EEF_UP, PICK, "empty", {("eef",): "free"}),
        (P.LIFT_EEF_UP, PICK, HELD, {("eef",): "free", **MOVED}),
        (P.LIFT_EEF_DOWN, PICK, HELD, {("eef",): "free", **MOVED}),
        (P.MOVE_EEF_FORWARD, PICK, HELD, {("eef",): "free", **MOVED}),
        (P.MOVE_BASE_LEFT, PICK, HELD, {("eef",): "free", **CARRIED}),
        (P.TURN_BASE_RIGHT, PICK, HELD, {("eef",): "free", **MOVED}),
        (P.NAVIGATE_TO_TARGET, DOOR, HELD, {("near",): "fridge_0", ("eef",): "home", **CARRIED}),
        (P.NAVIGATE_TO_SUPPORT, GLASS, HELD, {("near",): "fridge_0", ("eef",): "home", **CARRIED}),
        (P.NAVIGATE_TO_TARGET, DOOR, "gripping fridge_0", {("near",): "fridge_0", ("eef",): "home"}),
    ],
)
def test_effects(primitive: P, context: Context, hand: Value, written: dict[Fact, Value]) -> None:
    assert dict(effect(primitive, context, hand)) == written


@pytest.mark.parametrize(
    ("primitive", "parameter", "written"),
    [
        (P.ARTICULATE_OPEN, (0.0, 0.7), True),
        (P.ARTICULATE_OPEN, (0.0, 1.2), True),
        (P.ARTICULATE_OPEN, (0.0, 0.0), False),
        (P.ARTICULATE_OPEN, (0.0, 0.05), False),
        (P.ARTICULATE_CLOSE, (0.0, 0.5), False),
        (P.ARTICULATE_CLOSE, (0.0, 1.2), False),
        (P.ARTICULATE_CLOSE, (0.5, 1.0), True),
        (P.ARTICULATE_CLOSE, (0.4, 1.2), True),
        # 0.1 radians are open of a narrow range, and not of a wide one.
        (P.ARTICULATE_CLOSE, (0.1, 1.2), None),
    ],
)
def test_where_a_joint_ends_says_whether_it_is_open(
    primitive: P, parameter: tuple[float, float], written: Value
) -> None:
    assert dict(effect(primitive, DOOR, "gripping fridge_0", parameter)) == {("open", "fridge_0"): written}


def test_what_moves_by_nothing_moves_nothing() -> None:
    for number in range(P.LIFT_EEF_UP, P.MOVE_BASE_RIGHT + 1):
        assert effect(P(number), PICK, HELD, 0.0) == ()
        assert effect(P(number), PICK, HELD, 0.01) == effect(P(number), PICK, HELD)
    assert effect(P.TURN_BASE_LEFT, PICK, HELD, 0.0) == ()
    # A door that is to be closed by nothing stays as it is.
    assert effect(P.ARTICULATE_CLOSE, DOOR, "gripping fridge_0", (0.0, 0.0)) == ()


def test_placements_are_read_off_the_goal() -> None:
    goal = bddl.parse_formula("(and (not (ontop glass_0 table_0)) (inside glass_0 fridge_0))")
    assert placement_of(goal, "glass_0") == Placement("inside", "fridge_0")
    assert placement_of(goal, "apple_0") is None
    assert placement_of(bddl.parse_formula("(inside glass_0 gripper)"), "glass_0") is None
    assert placement_of(bddl.parse_formula("(or (inside glass_0 fridge_0) (hot glass_0))"), "glass_0") is None


def test_the_gripper_is_the_hand() -> None:
    condition = condition_of(bddl.Atom("inside", ("glass_0", "gripper")), True)
    assert condition == Condition(("hand",), HELD)
    assert bddl.format(condition.literal()) == "(inside glass_0 gripper)"  # type: ignore[arg-type]
    assert Condition(("hand",), "empty").literal() is None


def test_formulas_beyond_literals_stay_formulas() -> None:
    formula = bddl.parse_formula("(or (hot glass_0) (open fridge_0))")
    assert needed(formula) is formula
    assert needed(bddl.And(())) == ()


def test_the_tables_digest_is_stable() -> None:
    """A new digest makes every older certificate invalid, so it changes on purpose only."""
    assert library_sha() == "c21897705a434dea0420a16ef68a519debcde23441b822d8edbe0a0b025bdd63"
