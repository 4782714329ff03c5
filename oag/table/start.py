"""What is stated of a plan's start: the scene's facts, its closed predicates, and the robot's reset."""

from __future__ import annotations

import bddl
from oag.model.facts import ANY, EEF, EMPTY, GRIPPER, HAND, HOME, NEAR, Fact, Value, condition_of
from oag.model.scene import Scene
from oag.table.invariants import converse

RESET_REASONS = {
    NEAR: "the reset e_0 puts the robot at a fixed offset from the first target",
    EEF: "the reset e_0 brings the arm home",
    HAND: "the reset e_0 leaves the hand empty",
}


def reset_reason(fact: object) -> str:
    """Returns why the reset supplies one of the robot's variables, as certificates name it."""
    return next(reason for known, reason in RESET_REASONS.items() if list(known) == fact)


Start = tuple[tuple[Fact, Value], ...]


def reset_facts(first_target: str | None, scene_hand: Value) -> dict[Fact, str]:
    """Returns what the robot's reset supplies before the first subtask.

    Args:
        first_target: Target of the first subtask; None when there is none.
        scene_hand: The hand's value by the scene's own facts, which the reset then does not touch; None for none.

    Source: the paper starts the first flows without NAVIGATE_TO_TARGET ("we initialize the robot at a fixed offset
    distance"): the reset plays the part of a transfer e_0.
    """
    facts: dict[Fact, str] = {EEF: HOME}
    if scene_hand is None:
        facts[HAND] = EMPTY
    if first_target is not None:
        facts[NEAR] = first_target
    return facts


def scene_facts(scene: Scene) -> Start:
    """Returns what the scene states: an entry for each closed predicate, then for each literal and what it excludes."""
    values: dict[Fact, Value] = {}
    for predicate in sorted(scene.closed):
        arity = bddl.PREDICATES[predicate].arity
        values[(predicate, *(ANY,) * arity)] = False
    for formula in scene.facts:
        for literal in bddl.literals(formula) or ():
            condition = condition_of(literal.atom, literal.value)
            if condition.positive:
                values[condition.fact] = condition.value
                other = converse(condition.fact)
                if other is not None and (other[0], ANY, ANY) not in values:
                    values.setdefault(other, False)
            elif condition.fact != HAND:
                values[condition.fact] = False
    return tuple(values.items())


def contradictions(literals: tuple[bddl.Literal, ...]) -> str | None:
    """Decides whether a conjunction of literals breaks an invariant: None when it does not, else how.

    Source: docs/semantics.md, States: `inside` and `ontop` are irreflexive and antisymmetric, at most one thing is
    held. `inside` and `ontop` may hold at once (an apple in an open bowl), so that is no contradiction.
    """
    values: dict[bddl.Atom, bool] = {}
    related: set[tuple[str, str, str]] = set()
    held: str | None = None
    for literal in literals:
        atom = literal.atom
        if values.setdefault(atom, literal.value) is not literal.value:
            return f"{bddl.format(atom)} is said to hold and not to hold"
        if not literal.value or atom.predicate not in ("ontop", "inside"):
            continue
        first, second = atom.args
        if first == second:
            return f"nothing can be {atom.predicate} itself: {bddl.format(atom)}"
        if (atom.predicate, second, first) in related:
            return f"{bddl.format(atom)} excludes its converse"
        related.add((atom.predicate, first, second))
        if atom.predicate == "inside" and second == GRIPPER:
            if held not in (None, first):
                return f"the gripper holds one thing at a time, not {held} and {first}"
            held = first
    return None
