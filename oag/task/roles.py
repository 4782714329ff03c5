"""The roles of a simple task, read off its initial state and its goal where nobody named them.

Source: the paper's Definition of a simple task, T = <o_t, o_s1, o_s2, s_init, s_goal>: the target is what the subtask
changes, o_s1 is what the initial state relates it to, o_s2 what the goal relates it to.
"""

from __future__ import annotations

from typing import NamedTuple

import bddl
from oag.model.facts import GRIPPER
from oag.table.library import RESTING, placement_of

# Stands for a target that could not be inferred; the task then carries the reason as an issue.
NO_TARGET = ""


class Roles(NamedTuple):
    """The three objects of a simple task; `problem` says why the target could not be told, and is empty if it could."""

    target: str
    support_init: str | None
    support_goal: str | None
    problem: str = ""


def infer_roles(init: bddl.Formula, goal: bddl.Formula, target: str | None = None) -> Roles:
    """Returns the roles that an initial state and a goal imply.

    Args:
        init: Where the subtask starts.
        goal: Where it ends.
        target: The target, where it is known.

    Returns:
        The target is the one object that stands first in what the goal says beyond the initial state. When that is no
        object, or more than one, `target` is empty and `problem` says so.

    Example:
        >>> import bddl
        >>> infer_roles(bddl.parse_formula("(ontop cup_0 table_0)"), bddl.parse_formula("(not (ontop cup_0 table_0))"))
        Roles(target='cup_0', support_init='table_0', support_goal=None, problem='')
    """
    if target is None:
        subjects = _subjects(init, goal)
        if len(subjects) != 1:
            return Roles(NO_TARGET, None, None, _ambiguous(subjects))
        target = subjects[0]
    placement = placement_of(goal, target)
    return Roles(target, _support_before(init, goal, target), None if placement is None else placement.support)


def _subjects(init: bddl.Formula, goal: bddl.Formula) -> tuple[str, ...]:
    """Returns the objects that the goal says something new about; if it says nothing new, all that it speaks of."""
    literals = bddl.literals(goal)
    if literals is None:
        ordered = sorted(bddl.atoms(goal), key=str)
        return tuple(dict.fromkeys(atom.args[0] for atom in ordered if atom.args and not atom.args[0].startswith("?")))
    before = {(literal.atom, literal.value) for literal in bddl.literals(init) or ()}
    spoken = dict.fromkeys(literal.atom.args[0] for literal in literals if literal.atom.args)
    fresh = [literal for literal in literals if (literal.atom, literal.value) not in before]
    return tuple(dict.fromkeys(literal.atom.args[0] for literal in fresh if literal.atom.args)) or tuple(spoken)


def _ambiguous(subjects: tuple[str, ...]) -> str:
    """Returns why a target cannot be told."""
    if not subjects:
        return "the goal speaks of no object, so it cannot be told what the subtask is about"
    named = f"{', '.join(subjects[:-1])} and {subjects[-1]}"
    return f"the goal changes {named}, so it cannot be told which of them the subtask is about"


def _support_before(init: bddl.Formula, goal: bddl.Formula, target: str) -> str | None:
    """Returns what the target rests on or in at first, from the initial state, or from what the goal takes away."""
    for formula, value in ((init, True), (goal, False)):
        for literal in bddl.literals(formula) or ():
            atom = literal.atom
            rests = atom.predicate in RESTING and len(atom.args) == 2 and atom.args[1] != GRIPPER
            if rests and atom.args[0] == target and literal.value is value:
                return atom.args[1]
    return None
