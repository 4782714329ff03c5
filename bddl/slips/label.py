"""Which usual slip each mistake is, and hints that put the whole text right where only that helps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from bddl.diagnostics import Diagnostic, Reporter, one_line
from bddl.profiles import Profile
from bddl.reading.source import Source
from bddl.slips.catalogue import SLIP_OF_CODE, Slip
from bddl.slips.correction import LONGEST_TEXT, correct
from bddl.slips.draft import Draft, Edit
from bddl.slips.offers import concerns_whole, humble_hint, is_legal_offer
from bddl.slips.possible import possible_slips
from bddl.slips.rewriters import LOCAL_REWRITERS

# A text with more mistakes is not searched for slips, and neither is one too long to be corrected: its mistakes are
# labelled by their codes.
MOST_MISTAKES = 100
# A longer text is not repeated in a hint, corrected or not.
LONGEST_WHOLE = 1_600
# Slips of which the place alone shows too little: the hint is the whole text corrected.
_WHOLE: frozenset[Slip] = frozenset(
    {
        "binder-shape",
        "comma",
        "define-missing",
        "foreign-comment",
        "function-notation",
        "goal-section",
        "infix-operator",
        "init-connective",
        "json-text",
        "markdown-fence",
        "operator-symbol",
        "pddl-form",
        "prose-around",
        "quoted-name",
        "robot-predicate",
        "truth-constant",
        "typographic-character",
    }
)
# What to say where nobody but the author knows what was meant.
_ADVICE: Mapping[Slip, str] = {
    "ellipsis": "write out what the dots stand for",
    "equality": "BDDL does not compare names: write the condition for the object that is meant",
    "pddl-form": "BDDL has no numbers, actions or effects: write the condition that must hold, with forn to count",
    "define-missing": "write (define (problem NAME) (:domain NAME) ... (:goal FORMULA))",
    "no-formula": "write a formula such as (open refrigerator_0), and nothing else",
}


def labelled(reporter: Reporter, profile: Profile, objects: Mapping[str, str] | None) -> tuple[Diagnostic, ...]:
    """Returns the mistakes in a text with the slips that they are.

    Args:
        reporter: Has the text and its mistakes.
        profile: The dialect.
        objects: Category of each object of the scene, or None.

    Returns:
        The same mistakes, in the same order, with `slip` set where one is known, and with a better hint where the
        slip calls for the whole text to be rewritten.
    """
    found, text = reporter.diagnostics, reporter.text
    if len(text) > LONGEST_TEXT or len(found) > MOST_MISTAKES:
        return tuple(replace(item, slip=SLIP_OF_CODE.get(item.code)) for item in found)
    draft = Draft(text, profile, objects, reporter.forest)
    edits = [edit for rewriter in LOCAL_REWRITERS for edit in rewriter(draft)]
    slips = [_slip_of(item, reporter.source, edits, draft) for item in found]
    known = {(item.code, item.message) for item in found}
    refused = [not is_legal_offer(item, known, profile, objects) for item in found]
    corrected = ""
    if len(text) <= LONGEST_WHOLE and (any(refused) or any(slip in _WHOLE for slip in slips)):
        correction = correct(text, profile, objects)
        corrected = one_line(correction.text) if correction is not None else ""
    return tuple(
        _with_hint(replace(item, slip=slip), corrected, illegal, reporter)
        for item, slip, illegal in zip(found, slips, refused, strict=True)
    )


def _slip_of(found: Diagnostic, source: Source, edits: Iterable[Edit], draft: Draft) -> Slip | None:
    """Returns the slip that a correction at the place of a mistake would put right, or the one that its code means."""
    if found.severity != "error":
        return SLIP_OF_CODE.get(found.code)
    start = source.offset(found.line, found.column)
    end = start + max(1, found.length)
    possible = possible_slips(found)
    for edit in edits:
        if edit.start < end and start < max(edit.end, edit.start + 1) and edit.slip in possible:
            return edit.slip
    if found.code == "not-a-name" and found.expected == ("NAME",):
        return None
    if found.code == "missing-section":
        return "goal-missing" if found.expected == (":goal",) else None
    if found.code == "no-parentheses" and len(draft.words) > 4:
        return "no-formula"
    return SLIP_OF_CODE.get(found.code)


def _with_hint(found: Diagnostic, corrected: str, illegal: bool, reporter: Reporter) -> Diagnostic:
    """Returns a mistake with the whole text corrected where its slip calls for that, or where its own is illegal."""
    slip = found.slip
    if (slip in _WHOLE or (illegal and concerns_whole(found))) and corrected:
        return replace(found, hint=f"write {corrected}", replacement=reporter.instead_of_all(corrected))
    if slip is not None and slip in _ADVICE:
        return replace(found, hint=_ADVICE[slip], replacement=None)
    return replace(found, hint=humble_hint(found, reporter.text), replacement=None) if illegal else found
