"""Which usual slip each mistake is, and hints that put the whole text right where only that helps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import accumulate

from bddl.diagnostics import Diagnostic, Reporter, one_line
from bddl.profiles import Profile
from bddl.slips.catalogue import SLIP_OF_CODE, Slip
from bddl.slips.correction import correct
from bddl.slips.draft import Draft, Edit
from bddl.slips.rewriters import LOCAL_REWRITERS

# A longer text, or one with more mistakes, is not searched for slips; its mistakes are labelled by their codes.
LONGEST_TEXT = 20_000
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
    starts = _line_starts(text)
    slips = [_slip_of(item, starts, edits, draft) for item in found]
    corrected = ""
    if len(text) <= LONGEST_WHOLE and any(slip in _WHOLE for slip in slips):
        correction = correct(text, profile, objects)
        corrected = one_line(correction.text) if correction is not None else ""
    return tuple(
        replace(item, slip=slip, hint=_hint(item, slip, corrected)) for item, slip in zip(found, slips, strict=True)
    )


def _line_starts(text: str) -> list[int]:
    return [0, *accumulate(len(line) + 1 for line in text.split("\n"))]


def _slip_of(found: Diagnostic, starts: list[int], edits: Iterable[Edit], draft: Draft) -> Slip | None:
    """Returns the slip that a correction at the place of a mistake would put right, or the one that its code means."""
    if found.severity != "error":
        return SLIP_OF_CODE.get(found.code)
    start = starts[min(found.line, len(starts)) - 1] + found.column - 1
    end = start + max(1, found.length)
    for edit in edits:
        if edit.start < end and start < max(edit.end, edit.start + 1):
            return edit.slip
    if found.code == "missing-section":
        return "goal-missing" if found.expected == (":goal",) else None
    if found.code == "no-parentheses" and len(draft.words) > 4:
        return "no-formula"
    return SLIP_OF_CODE.get(found.code)


def _hint(found: Diagnostic, slip: Slip | None, corrected: str) -> str:
    if slip in _WHOLE and corrected:
        return f"write {corrected}"
    return _ADVICE.get(slip, found.hint) if slip is not None else found.hint
