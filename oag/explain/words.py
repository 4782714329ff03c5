"""What is needed, what is the case instead, and why a formula beyond literals is false, in words.

Source: docs/codes/.
"""

from __future__ import annotations

import bddl
from oag.model.facts import EEF, EMPTY, HAND, NEAR, Condition, Value, condition_of, held_by
from oag.progression.obligations import CausalLink, Obligation
from oag.progression.progress import Trace, producer_place
from oag.table.library import RESTING


def needed_text(condition: Condition | None, formula: bddl.Formula | None) -> str | None:
    """Returns a needed literal, or a formula beyond literals, in words."""
    if condition is not None:
        return condition.text()
    return None if formula is None else bddl.format(formula)


def state_text(condition: Condition, value: Value) -> str:
    """Returns what is the case instead of a condition."""
    fact = condition.fact
    if fact == HAND:
        item = held_by(value)
        if item is not None:
            return f"the hand holds {item}"
        return "the hand is empty" if value == EMPTY else f"the hand grips {str(value).partition(' ')[2]}"
    if fact == NEAR:
        return f"the robot is at {value}"
    if fact == EEF:
        return f"the arm is {value}"
    return "it is true" if value is True else "it is false"


def verb(condition: Condition) -> str:
    """Returns what a step would have to do, such as `opens it`."""
    fact, value = condition.fact, condition.value
    if fact == NEAR:
        return f"navigates to {value}"
    if fact == EEF:
        position, _, target = str(value).partition(" ")
        return f"{'approaches' if position == 'before' else 'converges on'} {target}"
    if fact == HAND:
        action, _, target = str(value).partition(" ")
        if not condition.positive:
            return "lets go of it"
        return "lets go" if value == EMPTY else f"{'grasps' if action == 'holding' else 'grips'} {target}"
    if fact[0] == "open":
        return "opens it" if condition.positive else "closes it"
    if fact[0] in RESTING:
        return "puts it there" if condition.positive else "takes it away"
    return "makes it true" if condition.positive else "makes it false"


def why_false(trace: Trace, obligation: Obligation, formula: bddl.Formula | None, objects: dict[str, str]) -> str:
    """Returns what makes a formula false; conjuncts that hold are not named."""
    if obligation.cases is not None:
        said = _said(trace, obligation.links)
        return f"it is false in every state in which the plan gets here{f', with {said}' if said else ''}"
    conjuncts = () if formula is None else bddl.conjuncts(formula)
    reasons = [(part, read) for part in conjuncts if (read := _falsified_by(part, obligation.links, objects))]
    if len(conjuncts) < 2 or not reasons:
        said = _said(trace, obligation.links)
        return f"it is false: {said}" if said else "it is false in every state"
    return "\n".join(f"{bddl.format(part)} is false: {_said(trace, read)}" for part, read in reasons)


def _falsified_by(part: bddl.Formula, links: tuple[CausalLink, ...], objects: dict[str, str]) -> tuple[CausalLink, ...]:
    """Returns the facts that make a formula false; none when it is not known to be."""
    known = {(link.condition.fact, link.condition.value): link for link in links}
    read: dict[bddl.Atom, CausalLink] = {}

    def value(atom: bddl.Atom) -> bool | None:
        condition = condition_of(atom, True)
        link = known.get((condition.fact, condition.value))
        if link is None:
            return None
        read[atom] = link
        return link.condition.positive

    return tuple(read.values()) if bddl.evaluate(part, value, objects=objects) is False else ()


def _said(trace: Trace, links: tuple[CausalLink, ...]) -> str:
    return ", ".join(f"{link.condition.text()} since {_since(trace, link)}" for link in links)


def _since(trace: Trace, link: CausalLink) -> str:
    """Returns the place from which on a fact has been as it is."""
    if link.value is None:
        return producer_place(trace, link.producer)
    return producer_place(trace, trace.since(link.condition.fact, link.value, link.producer).time)
