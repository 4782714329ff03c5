"""Repair wrong texts of language models, and label their mistakes with slips.

A correction is offered only where the intended text is certain and legal.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

from bddl import rewriters
from bddl.diagnostics import SLIP_OF_CODE, Code, Diagnostic, Replacement, Reporter, Slip, Source, one_line
from bddl.dialects import Profile, find_profile
from bddl.parser import TextReading, read_text
from bddl.problem import Objects, categories_of
from bddl.rewriters import TextDraft, TextEdit

Rewriter: TypeAlias = Callable[[TextDraft], Iterable[TextEdit]]

# In this order: first what hides the words, then how they are joined, then the choice of words.
REWRITERS: tuple[Rewriter, ...] = (
    rewriters.fix_characters,
    rewriters.remove_fences,
    rewriters.open_json,
    rewriters.find_ellipses,
    rewriters.remove_comments,
    rewriters.unquote,
    rewriters.turn_calls,
    rewriters.remove_commas,
    rewriters.replace_symbols,
    rewriters.convert_truth_values,
    rewriters.shape_binders,
    rewriters.turn_infix,
    rewriters.wrap_bare_atoms,
    rewriters.remove_prose,
    rewriters.open_sections,
    rewriters.join_formulas,
    rewriters.balance_parentheses,
    rewriters.name_sections,
    rewriters.convert_pddl,
    rewriters.choose_predicates,
    rewriters.choose_objects,
)
# Those that change single places, and leave the parentheses and the order of arguments alone.
LOCAL_REWRITERS = tuple(rewriter for rewriter in REWRITERS if rewriter is not rewriters.balance_parentheses)

_MOST_ROUNDS = 12
# A longer text is not corrected as a whole.
LONGEST_TEXT = 20_000


# A text with more mistakes, or one too long to be corrected, is not searched for slips: its mistakes are labelled by
# their codes.
MOST_MISTAKES = 100
# A longer text is not repeated in a hint, corrected or not.
LONGEST_WHOLE = 1_600
# Slips whose place alone shows too little: the hint is the whole corrected text.
_WHOLE: frozenset[Slip] = frozenset({
    "binder-shape", "comma", "define-missing", "foreign-comment", "function-notation", "goal-section",
    "infix-operator", "init-connective", "json-text", "markdown-fence", "operator-symbol", "pddl-form",
    "prose-around", "quoted-name", "robot-predicate", "truth-constant", "typographic-character",
})  # fmt: skip
# Advice where only the author knows what was meant.
_ADVICE: Mapping[Slip, str] = {
    "ellipsis": "write out what the dots stand for",
    "equality": "BDDL does not compare names: write the condition for the object that is meant",
    "pddl-form": "BDDL has no numbers, actions or effects: write the condition that must hold, with forn to count",
    "define-missing": "write (define (problem NAME) (:domain NAME) ... (:goal FORMULA))",
    "no-formula": "write a formula such as (open refrigerator_0), and nothing else",
}
# Slips of writing, not of meaning: they can look like any mistake.
_OF_WRITING: frozenset[Slip] = frozenset({
    "comma", "ellipsis", "foreign-comment", "function-notation", "infix-operator", "json-text", "markdown-fence",
    "operator-symbol", "prose-around", "quoted-name", "typographic-character",
})  # fmt: skip
_OF_OBJECTS: frozenset[Slip] = frozenset(
    {"invented-object", "letter-case", "object-variant", "stray-question-mark", "truth-constant", "equality"}
)
_OF_PREDICATES: frozenset[Slip] = frozenset({
    "equality", "goal-section", "invented-predicate", "misspelt-word", "opposite-predicate", "pddl-form",
    "predicate-synonym", "robot-predicate", "truth-constant",
})  # fmt: skip
_OF_CODE: Mapping[Code, frozenset[Slip]] = {
    "bad-binder": frozenset({"binder-shape"}),
    "bad-init": frozenset({"init-connective", "stray-question-mark"}),
    "bad-name": frozenset({"letter-case", "stray-question-mark", "truth-constant", "equality"}),
    "bad-section": frozenset({"pddl-form", "several-goals", "bare-words"}),
    "missing-section": frozenset({"misspelt-section"}),
    "no-parentheses": frozenset({"bare-words"}),
    "not-a-formula": frozenset({"bare-words", "truth-constant", "several-goals", "binder-shape", "equality"}),
    "not-a-name": frozenset({"pddl-form", "truth-constant", "equality", "extra-parenthesis", "several-goals"}),
    "repeated-section": frozenset({"several-goals"}),
    "several-formulas": frozenset({"define-missing", "several-goals"}),
    "text-around": frozenset({"bare-words", "define-missing", "several-goals"}),
    "unbound-variable": frozenset({"binder-shape", "stray-question-mark", "unbound-variable"}),
    "unknown-object": _OF_OBJECTS,
    "unknown-predicate": _OF_PREDICATES | {"define-missing", "bare-words"},
    "unknown-section": frozenset({"goal-section", "misspelt-section", "pddl-form"}),
    "unsupported-form": frozenset({"pddl-form"}),
    "wrong-arity": frozenset({"argument-count", "bare-words", "truth-constant", "pddl-form", "several-goals"}),
    "wrong-kind": frozenset({"define-missing", "goal-section", "pddl-form"}),
}
# Mistakes in words, which a piece of a text may share with the text: each has a hint of its own.
_OF_WORDS: frozenset[Code] = frozenset(
    {"unknown-category", "unknown-object", "unknown-predicate", "unknown-room", "wrong-arity"}
)
# Advice where the form that a hint would offer is illegal, too.
_FALLBACK: Mapping[Code, str] = {
    "function-notation": "write (NAME ARGUMENT ...)",
    "no-parentheses": "write a formula such as (open refrigerator_0)",
    "not-a-name": "join formulas with (and ...)",
}


@dataclass(frozen=True, slots=True)
class Correction:
    """The legal text that a wrong one was meant to be.

    Attributes:
        text: The corrected text.
        slips: The corrected slips, in the order of their correction, each once.
    """

    text: str
    slips: tuple[Slip, ...]


def correct(text: str, profile: str | Profile = "scene", objects: Objects | None = None) -> Correction | None:
    """Return a text with the slips of language models corrected.

    Nothing is invented: there is no correction where the text does not show what was meant. Examples are an object that
    resembles no other, an ellipsis, and a predicate that does not exist. Neither is there one when the result would be
    illegal. The caller decides whether to take it.

    Example:
        >>> import bddl
        >>> bddl.correct("```\\ninside(glass_0, fridge_0) and (on cup_0 table_0)\\n```").text
        '(and (inside glass_0 fridge_0) (ontop cup_0 table_0))'
    """
    if not isinstance(text, str):
        raise TypeError(f"BDDL text is a str, not {type(text).__name__}.")
    dialect = find_profile(profile, text)
    known = None if objects is None else categories_of(objects)
    legal = _make_legal(TextDraft(text, dialect, known))
    if legal is None:
        return None
    swapped = list(rewriters.swap_roles(legal[0]))
    slips = dict.fromkeys([*legal[1], *(edit.slip for edit in swapped)])
    return Correction(legal[0].edited(swapped).text, tuple(slips))


def _make_legal(draft: TextDraft) -> tuple[TextDraft, list[Slip]] | None:
    """Return a text with its slips corrected, and these slips; None when that is not certain."""
    if len(draft.text) > LONGEST_TEXT:
        return None
    slips: list[Slip] = []
    for _ in range(_MOST_ROUNDS):
        before = draft.text
        for rewriter in () if _is_legal(draft) else REWRITERS:
            edits = list(rewriter(draft))
            if any(edit.text is None for edit in edits):
                return None
            if edits:
                slips += [edit.slip for edit in edits]
                draft = draft.edited(edits)
                if rewriter is rewriters.balance_parentheses and _is_legal(draft):
                    break
        if draft.text == before:
            break
    draft = TextDraft(draft.text.strip(), draft.profile, draft.objects)
    return (draft, slips) if _is_legal(draft) else None


def _is_legal(draft: TextDraft) -> bool:
    return read_text(draft.text, "any", draft.profile, draft.objects).found is not None


def _is_legal_offer(
    found: Diagnostic,
    own: tuple[Code, str],
    known: Collection[tuple[Code, str]],
    profile: Profile,
    objects: Mapping[str, str] | None,
) -> bool:
    """Decide whether a hint offers no form, or one that may be written as it is."""
    if found.replacement is None or not found.replacement.text.startswith(("(", "[")):
        return True
    reporter = read_text(found.replacement.text, "any", profile, objects).reporter
    # A piece of a text may use the variables and the sections around it.
    return all(
        item.severity != "error"
        or item.code == "unbound-variable"
        or (item.code in _OF_WORDS and (mistake := _mistake_identity(item, reporter)) in known and mistake != own)
        for item in reporter.diagnostics
    )


def _mistake_identity(found: Diagnostic, reporter: Reporter) -> tuple[Code, str]:
    """Return the identity of a mistake, wherever it stands: its code and the words at its place."""
    start = reporter.source.offset(found.line, found.column)
    return found.code, reporter.text[start : start + found.length]


def label_slips(reading: TextReading, objects: Mapping[str, str] | None) -> tuple[Diagnostic, ...]:
    """Return the mistakes in a text, labelled with their slips."""
    reporter, profile = reading.reporter, reading.profile
    found, text = reporter.diagnostics, reporter.text
    if len(text) > LONGEST_TEXT or len(found) > MOST_MISTAKES:
        return tuple(replace(item, slip=SLIP_OF_CODE.get(item.code)) for item in found)
    draft = TextDraft(text, profile, objects, reading.forest)
    edits = [edit for rewriter in LOCAL_REWRITERS for edit in rewriter(draft)]
    slips = [_slip_of(item, reporter.source, edits, draft) for item in found]
    mistakes = [_mistake_identity(item, reporter) for item in found]
    illegal = [
        not _is_legal_offer(item, own, frozenset(mistakes), profile, objects)
        for item, own in zip(found, mistakes, strict=True)
    ]
    whole = [
        slip in _WHOLE or item in reporter.whole_text_mistakes or (wrong and item.code in _FALLBACK)
        for item, slip, wrong in zip(found, slips, illegal, strict=True)
    ]
    corrected = ""
    if len(text) <= LONGEST_WHOLE and any(whole):
        legal = _make_legal(TextDraft(text, profile, objects))
        corrected = one_line(legal[0].text) if legal is not None else ""
    results: list[Diagnostic] = []
    for item, slip, all_of_it, wrong in zip(found, slips, whole, illegal, strict=True):
        hint, offer = item.hint, item.replacement
        if all_of_it and corrected:
            alternative = item.code == "several-formulas" and slip not in _WHOLE
            hint = f"to ask for all of them, write {corrected}" if alternative else f"write {corrected}"
            offer = Replacement(0, len(text), corrected)
        elif slip is not None and slip in _ADVICE:
            hint, offer = _ADVICE[slip], None
        elif wrong:
            shape = f"write {item.expected[0]}" if item.code == "wrong-arity" else ""
            hint, offer = _FALLBACK.get(item.code, shape), None
        results.append(replace(item, slip=slip, hint=hint, replacement=offer))
    return tuple(results)


def _slip_of(found: Diagnostic, source: Source, edits: Iterable[TextEdit], draft: TextDraft) -> Slip | None:
    """Return the slip that is corrected at the place of a mistake, or else the slip of its code."""
    if found.severity != "error":
        return SLIP_OF_CODE.get(found.code)
    start = source.offset(found.line, found.column)
    end = start + max(1, found.length)
    possible = _OF_WRITING | _OF_CODE.get(found.code, frozenset())
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
