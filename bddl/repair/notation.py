"""Slips of notation: operators between or before their operands, calls, atoms and binders without their parentheses."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise

from bddl.reading.parentheses import repair
from bddl.reading.words import Group, Item, Word, words_in
from bddl.repair.draft import TextDraft, TextEdit
from bddl.syntax.codes import SLIP_OF_CODE, Slip
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.names import SYNONYM_OF, near_names
from bddl.syntax.tree import QUANTIFIER_WORDS
from bddl.syntax.vocabulary import FORM_SYNONYMS

# Operators that may stand between formulas, weakest first, with the connective that each one is.
_LEVELS: tuple[dict[str, str], ...] = (
    {"imply": "imply", "implies": "imply", "->": "imply", "=>": "imply", "→": "imply", "⇒": "imply"},
    {"or": "or", "|": "or", "||": "or", "∨": "or"},
    {"and": "and", "&": "and", "&&": "and", "∧": "and"},
)
_INFIX = {word: connective for level in _LEVELS for word, connective in level.items()}
_SYMBOLS = {"!", "~", "¬"}
_NEGATIONS = {"not", *_SYMBOLS}
# What can be called: a word, and no tag or sign.
_CALLED = re.compile(r"[\w.\-:]+")
# More operands than this are no slip of a pen.
_MOST_OPERANDS = 200


def replace_symbols(draft: TextDraft) -> Iterator[TextEdit]:
    """Symbols at the head of a form or before one become the connectives that they stand for."""
    for group in draft.groups:
        head = group.head
        if head is not None and not any(map(str.isalpha, head.key)) and head.key in FORM_SYNONYMS:
            yield TextEdit(head.offset, head.end, FORM_SYNONYMS[head.key], "operator-symbol")
    for items in _sequences(draft):
        for word, operand in pairwise(items[1:]):
            if isinstance(word, Word) and word.text in _SYMBOLS and isinstance(operand, Group):
                yield TextEdit(word.offset, operand.end, f"(not {draft.quote([operand])})", "operator-symbol")


def turn_calls(draft: TextDraft) -> Iterator[TextEdit]:
    """Calls such as `open(x)` become forms such as `(open x)`."""
    words = draft.words
    called: set[int] = set()
    for position, (word, following) in enumerate(pairwise(words)):
        touches = word.kind == "NAME" and following.kind == "OPEN" and word.end == following.offset
        if not touches or not _CALLED.fullmatch(word.text):
            continue
        before = words[position - 1] if position else None
        if before is None or before.kind != "OPEN" or before.offset in called:
            called.add(following.offset)
            yield TextEdit(word.offset, following.end, f"({word.text} ", "function-notation")
        elif word.key in draft.profile.predicates:
            yield from _undouble(words, position)


def _undouble(words: Sequence[Word], position: int) -> Iterator[TextEdit]:
    """Yields the change from `(open(x))` to `(open x)`: the inner parentheses go."""
    depth = 0
    for word in words[position + 1 :]:
        depth += (word.kind == "OPEN") - (word.kind == "CLOSE")
        if depth > 1:
            return
        if depth == 0:
            yield TextEdit(words[position + 1].offset, words[position + 1].end, " ", "function-notation")
            yield TextEdit(word.offset, word.end, "", "function-notation")
            return


def turn_infix(draft: TextDraft) -> Iterator[TextEdit]:
    """Operators between formulas move to the front; `not` binds strongest, then `and`, then `or`, then `imply`."""
    for items in _sequences(draft):
        if any(isinstance(item, Word) and item.key in _INFIX for item in items[1:]):
            text = _prefix(draft, list(items[:_MOST_OPERANDS]))
            if text:
                inside = items is not draft.forest
                yield TextEdit(items[0].offset, items[-1].end, text[1:-1] if inside else text, "infix-operator")
    for group in draft.groups:
        if len(group.items) != 3 or not group.is_flat:
            continue
        # From `(glass_0 on table_0)` to `(ontop glass_0 table_0)`.
        first, middle, last = words_in(group.items)
        name = SYNONYM_OF.get(middle.key, middle.key)
        spec = draft.profile.predicates.get(name)
        free = first.key not in draft.profile.words and first.kind != "SECTION"
        if free and spec is not None and spec.arity == 2:
            yield TextEdit(group.offset, group.end, f"({name} {first.text} {last.text})", "infix-operator")


def wrap_bare_atoms(draft: TextDraft) -> Iterator[TextEdit]:
    """Atoms get their own parentheses, inside a connective or alone in the text, and so does a loose `not`."""
    forest = draft.forest
    first = forest[0] if forest else None
    if len(forest) == 2 and isinstance(first, Word) and first.key in _NEGATIONS and isinstance(forest[1], Group):
        slip: Slip = "bare-words" if first.key == "not" else "operator-symbol"
        yield TextEdit(first.offset, forest[1].end, f"(not {draft.quote(forest[1:])})", slip)
    elif isinstance(first, Word) and all(isinstance(item, Word) for item in forest) and _operand(draft, list(forest)):
        yield TextEdit(first.offset, forest[-1].end, _operand(draft, list(forest)), "bare-words")
    for group in draft.groups:
        head, inner = group.head, list(group.items[1:])
        if head is not None and head.key in draft.profile.forms - QUANTIFIER_WORDS and _is_bare_atom(draft, inner):
            yield TextEdit(inner[0].offset, inner[-1].end, f"({draft.quote(inner)})", "bare-words")


def shape_binders(draft: TextDraft) -> Iterator[TextEdit]:
    """Binders get their parentheses and their hyphen; two variables in one become two quantifiers."""
    for group in draft.groups:
        if group.head is None or group.head.key not in ("forall", "exists") or len(group.items) < 3:
            continue
        binder = group.items[1]
        if isinstance(binder, Word):
            loose = words_in(group.items[1:-1])
            shaped = _binder(loose)
            if shaped and len(loose) == len(group.items) - 2:
                yield TextEdit(loose[0].offset, loose[-1].end, shaped, "binder-shape")
            continue
        words = words_in(binder.items)
        variables = [word for word in words if word.kind == "VARIABLE"]
        if len(variables) > 1 and len(words) == len(variables) + 2 and words[-2].kind == "HYPHEN":
            opening = [f"({variable.text} - {words[-1].text})" for variable in variables]
            between = f" ({group.head.key} ".join(opening)
            yield TextEdit(binder.offset, binder.end, between, "binder-shape")
            yield TextEdit(group.end, group.end, ")" * (len(variables) - 1), "binder-shape")
        elif _binder(words) and len(words) == len(binder.items) and words[1].kind != "HYPHEN":
            yield TextEdit(binder.offset, binder.end, _binder(words), "binder-shape")


def _binder(words: Sequence[Word]) -> str:
    """Returns the binder that two or three loose words mean, or ""."""
    if len(words) == 3 and (words[1].kind == "HYPHEN" or words[1].key in ("in", ":", "of", "∈")):
        words = (words[0], words[2])
    if len(words) != 2 or words[0].kind != "VARIABLE" or words[1].kind != "NAME":
        return ""
    return f"({words[0].text} - {words[1].text})"


def _sequences(draft: TextDraft) -> Iterator[Sequence[Item]]:
    """Yields the items of the text and of every form in it, where there are several."""
    if len(draft.forest) > 1:
        yield draft.forest
    for group in draft.groups:
        if len(group.items) > 1:
            yield group.items


def _is_bare_atom(draft: TextDraft, items: Sequence[Item]) -> bool:
    """Decides whether items are a predicate and as many names as it takes."""
    first = items[0] if items else None
    if not isinstance(first, Word) or not all(isinstance(item, Word) for item in items):
        return False
    spec = draft.profile.predicates.get(SYNONYM_OF.get(first.key, first.key))
    return spec is not None and spec.arity == len(items) - 1


def _prefix(draft: TextDraft, items: list[Item], level: int = 0) -> str:
    """Returns the formula that operands with operators between them say, or "" when they say none."""
    if level == len(_LEVELS):
        return _operand(draft, items)
    parts: list[list[Item]] = [[]]
    for item in items:
        if isinstance(item, Word) and item.key in _LEVELS[level]:
            parts.append([])
        else:
            parts[-1].append(item)
    if len(parts) == 1:
        return _prefix(draft, items, level + 1)
    texts = [_prefix(draft, part, level + 1) for part in parts]
    if not all(texts):
        return ""
    if level:
        connective = next(iter(_LEVELS[level].values()))
        return f"({connective} {' '.join(texts)})"
    nested = texts[-1]
    for text in reversed(texts[:-1]):
        nested = f"(imply {text} {nested})"
    return nested


def _operand(draft: TextDraft, items: list[Item]) -> str:
    """Returns one operand: a form, a bare atom, or either behind `not`; "" when it is none of these."""
    negations = 0
    while len(items) > 1 and isinstance(items[0], Word) and items[0].key in _NEGATIONS:
        items = items[1:]
        negations += 1
    if len(items) == 1 and isinstance(items[0], Group):
        text = draft.quote(items)
    elif _is_bare_atom(draft, items):
        text = f"({draft.quote(items)})"
    else:
        return ""
    return "(not " * negations + text + ")" * negations


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
            yield TextEdit(word.offset, word.offset, word.text, "missing-parenthesis")
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
        defined = f"(define {draft.quote(forest)})" if "problem" in heads else None
        yield TextEdit(forest[0].offset, forest[-1].end, defined, "define-missing")
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
