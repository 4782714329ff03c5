"""A text with the usual slips put right: what a person would have read it as, if that is certain and legal."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeAlias

from bddl.diagnostics.repair import characters, composition, notation, word_choice
from bddl.diagnostics.repair.draft import TextDraft, TextEdit
from bddl.reading.reader import read_text
from bddl.syntax.codes import Slip
from bddl.syntax.problem import Objects, categories_of
from bddl.syntax.profiles import Profile, find_profile

Rewriter: TypeAlias = Callable[[TextDraft], Iterable[TextEdit]]

# In this order: what hides the words comes first, then how they are joined, then which words they are.
REWRITERS: tuple[Rewriter, ...] = (
    characters.fix_characters,
    characters.remove_fences,
    characters.open_json,
    characters.find_ellipses,
    characters.convert_comments,
    characters.unquote,
    notation.turn_calls,
    characters.remove_commas,
    notation.replace_symbols,
    word_choice.judge_truth_values,
    notation.shape_binders,
    notation.turn_infix,
    notation.wrap_bare_atoms,
    characters.remove_prose,
    composition.open_sections,
    composition.join_formulas,
    composition.balance_parentheses,
    composition.name_sections,
    word_choice.convert_pddl,
    word_choice.choose_predicates,
    word_choice.choose_objects,
    word_choice.swap_roles,
)
# Those that change single places, and leave the parentheses and the order of arguments alone.
LOCAL_REWRITERS: tuple[Rewriter, ...] = tuple(
    rewriter for rewriter in REWRITERS if rewriter not in (word_choice.swap_roles, composition.balance_parentheses)
)

_MOST_ROUNDS = 12
# A longer text is not corrected as a whole.
LONGEST_TEXT = 20_000


@dataclass(frozen=True, slots=True)
class Correction:
    """A legal text that a wrong one was meant to be.

    Attributes:
        text: The corrected text.
        slips: What was put right, in the order in which it was, each slip once.
    """

    text: str
    slips: tuple[Slip, ...]


def correct(text: str, profile: str | Profile = "scene", objects: Objects | None = None) -> Correction | None:
    """Returns a text with the slips of language models put right.

    Nothing is invented: where the text does not tell what was meant (an object that resembles no other, an ellipsis,
    a predicate that does not exist), there is no correction. Neither is there one when what came out would be
    illegal. Whoever asked for the text decides whether to take it.

    Args:
        text: A formula or a problem, as a model wrote it.
        profile: The dialect, or its name.
        objects: Category of each object of the scene, against which names are checked.

    Returns:
        The correction, with no slips when the text was legal, or None.

    Raises:
        UnknownProfile: There is no such profile.

    Example:
        >>> import bddl
        >>> bddl.correct("```\\ninside(glass_0, fridge_0) and (on cup_0 table_0)\\n```").text
        '(and (inside glass_0 fridge_0) (ontop cup_0 table_0))'
    """
    dialect = find_profile(profile)
    if not isinstance(text, str):
        raise TypeError(f"BDDL text is a str, not {type(text).__name__}.")
    known = None if objects is None else categories_of(objects)
    draft = TextDraft(text, dialect, known)
    slips: list[Slip] = []
    if len(text) > LONGEST_TEXT:
        return None
    rewriters = (word_choice.swap_roles,) if _is_legal(draft) else REWRITERS
    for _ in range(_MOST_ROUNDS):
        before = draft.text
        for rewriter in rewriters:
            edits = list(rewriter(draft))
            if any(edit.text is None for edit in edits):
                return None
            if edits:
                slips += [edit.slip for edit in edits]
                draft = draft.edited(edits)
        if draft.text == before:
            break
    draft = TextDraft(draft.text.strip(), dialect, known)
    if not _is_legal(draft):
        return None
    return Correction(draft.text, tuple(dict.fromkeys(slips)))


def _is_legal(draft: TextDraft) -> bool:
    return read_text(draft.text, "any", draft.profile, draft.objects).found is not None
