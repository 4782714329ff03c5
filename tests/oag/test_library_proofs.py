"""The table of primitives, proved for all states: invariants are preserved, and only the footprint is written.

Objects are the target, the support and two others, one of which the hand may hold. An invariant speaks of two objects
at a time, and a row of the table names no more than these, so what holds for four holds for any number.
"""

from __future__ import annotations

from itertools import product

import pytest

from bddl.smt import Script, Solver, conjunction, disjunction, negation
from oag.model.symbols import ANY, EMPTY, ROBOT_FACTS, Condition, Fact, Primitive, Value, gripping, holding
from oag.primitives.table import Context, Placement, effect, requirements

OBJECTS = ("target", "support", "held", "other")
RESTING: tuple[Fact, ...] = tuple((p, a, b) for p in ("ontop", "inside") for a, b in product(OBJECTS, repeat=2))
LOOSE: tuple[Fact, ...] = tuple(
    (p, a, b) for p in ("nextto", "touching", "under") for a, b in product(OBJECTS, repeat=2)
)
DOORS: tuple[Fact, ...] = tuple(("open", thing) for thing in OBJECTS)
WORLD = (*RESTING, *LOOSE, *DOORS)
# What carrying a thing touches, by docs/semantics.md: where it rests, and what it is beside.
IN_PLACE = (Primitive.GRASP, Primitive.UNGRASP, Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE)
DRIVING = tuple(p for p in Primitive if p.name.startswith(("NAVIGATE", "MOVE_BASE", "RETREAT")))

CONTEXTS = [
    Context("target", "support", placement, is_item, ("support",) if is_item else ("target", "support"), ("held",))
    for is_item in (True, False)
    for placement in (None, Placement("ontop", "support"), Placement("inside", "support"))
]
HANDS = (EMPTY, holding("target"), holding("held"), gripping("target"), gripping("support"))


def footprint(primitive: Primitive, context: Context, hand: str) -> set[Fact]:
    """Return the world facts that a primitive may change, as the documentation has them."""
    if primitive in (Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE):
        return {("open", "target")}
    item = hand.partition(" ")[2] if hand.startswith("holding") else None
    if primitive not in IN_PLACE and item is not None:
        # A hand that moves takes nothing out of a compartment.
        kept = () if primitive in DRIVING else ("inside",)
        rests = {fact for fact in RESTING if fact[1] == item and (fact[0] not in kept or fact[2] in context.vessels)}
        return rests | {fact for fact in LOOSE if item in fact[1:]}
    if primitive is Primitive.UNGRASP and item == "target" and context.placement is not None:
        relation = context.placement.relation
        return {(relation, "target", "support"), (relation, "support", "target")}
    return set()


def after(fact: Fact, written: dict[Fact, Value], before: str, script: Script) -> str:
    """Return the term of a fact's value after a step; the most specific of its patterns counts."""
    name = fact[0]
    patterns = [fact, (name, fact[1], ANY), (name, ANY, fact[-1]), (name, ANY, ANY)] if len(fact) == 3 else [fact]
    for pattern in patterns:
        if pattern in written:
            value = written[pattern]
            if value is None:
                script.declare(f"open_{before}")
                return f"open_{before}"
            return str(value is True).lower()
    return before


def invariants(values: dict[Fact, str]) -> str:
    """Return that nothing is on or in itself, and no two things on or in each other."""
    return conjunction(
        negation(conjunction(dict.fromkeys((values[p, a, b], values[p, b, a])))) for p, a, b in RESTING if a <= b
    )


def met(conditions: tuple[tuple[Condition, ...], ...], values: dict[Fact, str], robot: dict[Fact, str]) -> str:
    """Return that what a step needs is so, as far as it speaks of the world or the hand."""
    clauses = []
    for clause in conditions:
        terms = []
        for condition in clause:
            if condition.fact in ROBOT_FACTS:
                known = robot.get(condition.fact)
                truth = known is None or (known == condition.value) is condition.positive
                terms.append(str(truth).lower())
            else:
                term = values[condition.fact]
                terms.append(term if condition.positive else negation(term))
        clauses.append(disjunction(terms))
    return conjunction(clauses)


@pytest.mark.parametrize("primitive", list(Primitive), ids=lambda primitive: primitive.name)
def test_every_row_preserves_the_invariants_and_writes_inside_its_footprint(primitive: Primitive) -> None:
    ran = 0
    for context, hand in product(CONTEXTS, HANDS):
        script = Script()
        before = {fact: f"b{index}" for index, fact in enumerate(WORLD)}
        script.declare(*before.values())
        written = dict(effect(primitive, context, hand))
        later = {fact: after(fact, written, name, script) for fact, name in before.items()}
        script.require(invariants(before))
        script.require(met(requirements(primitive, context, hand), before, {("hand",): hand}))
        broken = script.name(negation(invariants(later)))
        outside = [fact for fact in WORLD if fact not in footprint(primitive, context, hand)]
        touched = script.name(
            disjunction(f"(xor {before[fact]} {later[fact]})" for fact in outside if later[fact] != before[fact])
        )
        session = Solver(script.text())
        if session.check().status == "unsat":
            continue
        ran += 1
        assert session.check([(broken, True)]).status == "unsat", (context, hand)
        assert session.check([(touched, True)]).status == "unsat", (context, hand)
        assert {fact for fact in written if len(fact) == 1} <= set(ROBOT_FACTS)
        # The invariants of the robot's variables hold by form: one value each, and never "unknown".
        assert all(isinstance(value, str) for fact, value in written.items() if len(fact) == 1)
    assert ran


def test_the_proof_would_notice_a_wrong_row() -> None:
    """UNGRASP without "its converse := false" breaks antisymmetry, and the proof says so."""
    script = Script()
    before = {fact: f"b{index}" for index, fact in enumerate(WORLD)}
    script.declare(*before.values())
    wrong: dict[Fact, Value] = {("inside", "target", "support"): True}
    later = {fact: after(fact, wrong, name, script) for fact, name in before.items()}
    script.require(invariants(before))
    script.require(negation(invariants(later)))
    assert Solver(script.text()).check().status == "sat"
