"""Why a formula beyond literals fails: which of its conjuncts are false, by which facts, and since when.

Source: docs/codes/.
"""

from __future__ import annotations

import bddl
from oag.model.facts import condition_of
from oag.progression.obligations import Link, Obligation
from oag.progression.progress import Trace, producer_place


def why_false(trace: Trace, obligation: Obligation, formula: bddl.Formula | None, objects: dict[str, str]) -> str:
    """Returns what makes a formula false; conjuncts that hold are not named.

    Args:
        trace: How the plan went.
        obligation: The place where the formula is needed.
        formula: The formula; None when it is not known.
        objects: Categories of the scene's objects.
    """
    if obligation.cases is not None:
        said = _said(trace, obligation.links)
        return f"it is false in every state in which the plan gets here{f', with {said}' if said else ''}"
    conjuncts = () if formula is None else bddl.conjuncts(formula)
    reasons = [(part, read) for part in conjuncts if (read := _falsified_by(part, obligation.links, objects))]
    if len(conjuncts) < 2 or not reasons:
        said = _said(trace, obligation.links)
        return f"it is false: {said}" if said else "it is false in every state"
    return "\n".join(f"{bddl.format(part)} is false: {_said(trace, read)}" for part, read in reasons)


def _falsified_by(part: bddl.Formula, links: tuple[Link, ...], objects: dict[str, str]) -> tuple[Link, ...]:
    """Returns the facts that make a formula false; none when it is not known to be."""
    known = {(link.condition.fact, link.condition.value): link for link in links}
    read: dict[bddl.Atom, Link] = {}

    def value(atom: bddl.Atom) -> bool | None:
        condition = condition_of(atom, True)
        link = known.get((condition.fact, condition.value))
        if link is None:
            return None
        read[atom] = link
        return link.condition.positive

    return tuple(read.values()) if bddl.evaluate(part, value, objects=objects) is False else ()


def _said(trace: Trace, links: tuple[Link, ...]) -> str:
    """Returns facts in words; each with the place from which on it has been so."""
    return ", ".join(f"{link.condition.text()} since {_since(trace, link)}" for link in links)


def _since(trace: Trace, link: Link) -> str:
    """Returns the place from which on a fact has been as it is."""
    if link.value is None:
        return producer_place(trace, link.producer)
    return producer_place(trace, trace.since(link.condition.fact, link.value, link.producer).time)
