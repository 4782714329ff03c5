"""Slips in the build of a text: parentheses, several formulas for one, sections for formulas and sections misspelt."""

from __future__ import annotations

from collections.abc import Iterator

from bddl.diagnostics.repair.draft import TextDraft, TextEdit
from bddl.reading.parentheses.balance import repair
from bddl.reading.words.forest import Group
from bddl.syntax.codes import SLIP_OF_CODE
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.names import near_names

_PROBLEM_HEADS = {"problem", ":domain", ":objects", ":init", ":goal"}


def balance_parentheses(draft: TextDraft) -> Iterator[TextEdit]:
    """Missing parentheses are put in and surplus ones removed."""
    text = draft.text
    if draft.balanced is not None:
        for group in draft.groups:
            only = group.items[0] if len(group.items) == 1 else None
            if isinstance(only, Group) and only.head is not None and only.head.key in draft.profile.words:
                yield TextEdit(group.offset, group.end, draft.quote([only]), "extra-parenthesis")
        return
    reporter = Reporter(text)
    words = repair(draft.words, draft.profile, reporter)
    slips = {SLIP_OF_CODE[found.code] for found in reporter.diagnostics if found.code in SLIP_OF_CODE}
    kept = {word.offset for word in words if not word.invented}
    for word in draft.words:
        if word.offset not in kept:
            yield TextEdit(word.offset, word.end, "", "extra-parenthesis")
    for word in words:
        if word.invented:
            yield TextEdit(word.offset, word.offset, ")", "missing-parenthesis")
    if not slips:
        yield TextEdit(0, len(text), " ".join(word.text for word in words), "extra-parenthesis")


def join_formulas(draft: TextDraft) -> Iterator[TextEdit]:
    """Several formulas in a row, in the text or in `:goal`, become the parts of one conjunction."""
    groups = [item for item in draft.forest if isinstance(item, Group)]
    words = draft.profile.words
    alone = 1 < len(groups) == len(draft.forest)
    if alone and all(group.head is not None and group.head.key in words for group in groups):
        yield TextEdit(groups[0].offset, groups[-1].end, f"(and {draft.quote(groups)})", "several-goals")
    for group in draft.groups:
        if group.head is not None and group.head.key == ":goal" and len(group.items) > 2:
            parts = group.items[1:]
            yield TextEdit(parts[0].offset, parts[-1].end, f"(and {draft.quote(parts)})", "several-goals")


def open_sections(draft: TextDraft) -> Iterator[TextEdit]:
    """A lone `(:goal F)` or `(goal F)` becomes F, and `(:init (and F G))` becomes `(:init F G)`."""
    forest = draft.forest
    only = forest[0] if len(forest) == 1 else None
    if isinstance(only, Group) and only.head is not None and only.head.key in (":goal", ":init", "goal"):
        if len(only.items) > 1 and all(isinstance(item, Group) for item in only.items[1:]):
            text = draft.quote(only.items[1:])
            joined = text if len(only.items) == 2 else f"(and {text})"
            yield TextEdit(only.offset, only.end, joined, "goal-section")
        return
    heads = [item.head.key for item in forest if isinstance(item, Group) and item.head is not None]
    if len(heads) == len(forest) > 1 and set(heads) <= _PROBLEM_HEADS:
        named = "problem" in heads
        yield TextEdit(forest[0].offset, forest[-1].end, _defined(draft) if named else None, "define-missing")
    for group in draft.groups:
        if group.head is not None and group.head.key == ":init" and len(group.items) == 2:
            inner = group.items[1]
            if isinstance(inner, Group) and inner.head is not None and inner.head.key == "and":
                yield TextEdit(inner.offset, inner.end, draft.quote(inner.items[1:]), "init-connective")


def name_sections(draft: TextDraft) -> Iterator[TextEdit]:
    """Misspelt names of sections become the right ones."""
    root = next((item for item in draft.forest if isinstance(item, Group)), None)
    if root is None or root.head is None or root.head.key != "define":
        return
    legal = ("problem", *draft.profile.sections, *draft.profile.ignored_sections)
    for item in root.items[1:]:
        head = item.head if isinstance(item, Group) else None
        if head is not None and head.key not in legal:
            near = near_names(head.text, legal)
            if near:
                yield TextEdit(head.offset, head.end, near[0], "misspelt-section")


def _defined(draft: TextDraft) -> str:
    return f"(define {draft.quote(draft.forest)})"
