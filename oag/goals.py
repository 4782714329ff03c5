"""The task goal that is read off a decomposition when the query gave none."""

from __future__ import annotations

import bddl


def default_goal(subtask_goals: tuple[bddl.Formula, ...]) -> bddl.Formula:
    """Returns the conjunction of the subtask goals that no later subtask's own goal negates.

    Such a goal cannot catch a dropped subtask, which is why a report says when it was used.

    Args:
        subtask_goals: In order.

    Example:
        >>> import bddl
        >>> opened, shut = bddl.parse_formula("(open box_0)"), bddl.parse_formula("(not (open box_0))")
        >>> bddl.format(default_goal((opened, shut)))
        '(not (open box_0))'

    Source: docs/semantics.md, Verdicts.
    """
    kept: dict[bddl.Atom, bool] = {}
    others: list[bddl.Formula] = []
    for goal in subtask_goals:
        literals = bddl.literals(goal)
        if literals is None:
            others.append(goal)
            continue
        for literal in literals:
            # A later goal about the same atom replaces an earlier one, and takes the later place in the order.
            kept.pop(literal.atom, None)
            kept[literal.atom] = literal.value
    parts = [atom if value else bddl.Not(atom) for atom, value in kept.items()] + others
    return parts[0] if len(parts) == 1 else bddl.And(tuple(parts))
