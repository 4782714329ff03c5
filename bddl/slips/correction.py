"""A text with the usual slips put right: what a person would have read it as, if that is certain and legal."""

from __future__ import annotations

from dataclasses import dataclass

from bddl.problem import Objects, categories_of
from bddl.profiles import Profile, find_profile
from bddl.reading.text import read_text
from bddl.slips.catalogue import Slip
from bddl.slips.draft import Draft
from bddl.slips.rewriters import REWRITERS, swap_roles

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
    draft = Draft(text, dialect, known)
    slips: list[Slip] = []
    if len(text) > LONGEST_TEXT:
        return None
    rewriters = (swap_roles,) if _is_legal(draft) else REWRITERS
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
    draft = Draft(draft.text.strip(), dialect, known)
    if not _is_legal(draft):
        return None
    return Correction(draft.text, tuple(dict.fromkeys(slips)))


def _is_legal(draft: Draft) -> bool:
    return read_text(draft.text, "any", draft.profile, draft.objects).found is not None
