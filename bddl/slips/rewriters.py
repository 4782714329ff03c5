"""The rewriters that put slips right, in the order in which they are tried."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeAlias

from bddl.slips import forms, notation, text, words
from bddl.slips.draft import Draft, Edit
from bddl.slips.words import swap_roles

Rewriter: TypeAlias = Callable[[Draft], Iterable[Edit]]

# In this order: what hides the words comes first, then how they are joined, then which words they are.
REWRITERS: tuple[Rewriter, ...] = (
    text.fix_characters,
    text.remove_fences,
    text.open_json,
    text.find_ellipses,
    text.convert_comments,
    text.unquote,
    notation.turn_calls,
    text.remove_commas,
    notation.replace_symbols,
    words.judge_truth_values,
    notation.shape_binders,
    notation.turn_infix,
    notation.wrap_bare_atoms,
    text.remove_prose,
    forms.open_sections,
    forms.join_formulas,
    forms.balance_parentheses,
    forms.name_sections,
    words.convert_pddl,
    words.choose_predicates,
    words.choose_objects,
    swap_roles,
)
# Those that change single places, and leave the parentheses and the order of arguments alone.
LOCAL_REWRITERS: tuple[Rewriter, ...] = tuple(
    rewriter for rewriter in REWRITERS if rewriter not in (swap_roles, forms.balance_parentheses)
)

__all__ = ["LOCAL_REWRITERS", "REWRITERS", "Rewriter", "swap_roles"]
