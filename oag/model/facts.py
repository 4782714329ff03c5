"""Facts and conditions: the atoms that plans read and write, and how they are said in words.

A fact is a tuple of strings: a predicate with its arguments, such as `("ontop", "glass_0", "table_0")`, with the value
True or False; or one of the robot's three variables, whose value is a phrase:

    ("near",)   id of the object that the base stands at
    ("eef",)    "home", "free", "before glass_0" or "at glass_0"
    ("hand",)   "empty", "holding glass_0" or "gripping refrigerator_0"

A variable has one value at a time, so the invariants "at most one object is held", "the hand is empty exactly when
nothing is held or gripped" and "near and eef are functional" hold by construction. The paper's
`(inside glass_0 gripper)` is the hand's value "holding glass_0". A name may be `*` where a fact is a pattern.

Source: docs/semantics.md, States.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import bddl

Fact = tuple[str, ...]
# None is the value "unknown".
Value = bool | str | None
ANY = "*"

NEAR: Fact = ("near",)
EEF: Fact = ("eef",)
HAND: Fact = ("hand",)
ROBOT_FACTS = (NEAR, EEF, HAND)

EMPTY = "empty"
HOME = "home"
FREE = "free"
GRIPPER = "gripper"


def holding(item: str) -> str:
    """Returns the hand's value when it holds an item."""
    return f"holding {item}"


def gripping(fixture: str) -> str:
    """Returns the hand's value when it grips a fixture's handle."""
    return f"gripping {fixture}"


def held_by(hand: Value) -> str | None:
    """Returns the item that a hand of this value holds, or None."""
    return hand[8:] if isinstance(hand, str) and hand.startswith("holding ") else None


class Condition(NamedTuple):
    """A fact that must have a value, or, when not `positive`, must not have it."""

    fact: Fact
    value: bool | str
    positive: bool = True

    def grade(self, value: Value) -> bool | None:
        """Decides the condition for the fact's value: None when that is unknown."""
        return None if value is None else (value == self.value) is self.positive

    def text(self) -> str:
        """Returns the condition in words, such as `not open(refrigerator_0)` or `inside(glass_0, gripper)`."""
        said = fact_text(self.fact, self.value)
        return said if self.positive else f"not {said}"

    @property
    def sayable(self) -> bool:
        """True when BDDL has a literal for the condition."""
        return self.fact not in ROBOT_FACTS or (self.fact == HAND and held_by(self.value) is not None)

    def literal(self) -> bddl.Formula | None:
        """Returns the condition as a BDDL literal, or None for one about the robot that BDDL cannot say."""
        if not self.sayable:
            return None
        item = held_by(self.value)
        atom = bddl.Atom(self.fact[0], self.fact[1:]) if item is None else bddl.Atom("inside", (item, GRIPPER))
        return atom if self.positive else bddl.Not(atom)


def made_true(condition: Condition) -> Value:
    """Returns a value that makes a condition true."""
    if condition.positive:
        return condition.value
    return EMPTY if condition.fact == HAND else False


def known_as(fact: Fact, value: bool | str) -> Condition:
    """Returns the condition that a fact with this value meets."""
    return Condition(fact, True, value) if isinstance(value, bool) else Condition(fact, value)


def condition_of(atom: bddl.Atom, value: bool) -> Condition:
    """Returns the condition that a BDDL literal stands for."""
    return condition_on((atom.predicate, *atom.args), value)


def condition_on(names: Fact, value: bool) -> Condition:
    """Returns the condition that a literal stands for whose atom is given as its predicate and arguments."""
    if names[0] == "inside" and names[2:] == (GRIPPER,):
        return Condition(HAND, holding(names[1]), value)
    return Condition(names, True, value)


def fact_text(fact: Fact, value: Value) -> str:
    """Returns what a fact of this value says, in words."""
    if fact == HAND:
        item = held_by(value)
        if item is not None:
            return f"inside({item}, {GRIPPER})"
        return "handempty" if value == EMPTY else str(value).replace(" ", "(", 1) + ")"
    if fact in (NEAR, EEF):
        return f"{fact[0]}({value})"
    said = f"{fact[0]}({', '.join(fact[1:])})"
    return said if value is True else f"not {said}"


def generalisations(fact: Fact) -> tuple[Fact, ...]:
    """Returns the fact and the patterns that match it, the most specific first."""
    if len(fact) == 3:
        predicate, first, second = fact
        return (fact, (predicate, first, ANY), (predicate, ANY, second), (predicate, ANY, ANY))
    if len(fact) == 2:
        return (fact, (fact[0], ANY))
    return (fact,)


def overlap(first: Fact, second: Fact) -> bool:
    """Decides whether two facts or patterns have an instance in common."""
    return (
        len(first) == len(second)
        and first[0] == second[0]
        and all(a == b or ANY in (a, b) for a, b in zip(first[1:], second[1:], strict=True))
    )


def conjunction(goal: bddl.Formula, conditions: Iterable[Condition]) -> bddl.Formula:
    """Returns a goal and the conditions that BDDL can say, each once."""
    parts = dict.fromkeys(bddl.conjuncts(goal))
    for condition in conditions:
        literal = condition.literal()
        if literal is not None:
            parts.setdefault(literal)
    return next(iter(parts)) if len(parts) == 1 else bddl.And(tuple(parts))
