"""Rewriters of wrong texts: each corrects one kind of slip in characters, notation or choice of words.

Characters are typographic signs, fences, JSON, comments, quotes, commas and prose. Notation is infix operators, calls,
and missing parentheses. Words are predicates, objects, truth values, question marks and forms of PDDL.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import pairwise
from typing import NamedTuple

from bddl.ast import QUANTIFIER_WORDS
from bddl.diagnostics import SLIP_OF_CODE, Reporter, Slip, Source
from bddl.dialects import FORM_SYNONYMS, ROOM, SYNONYM_OF, VAGUE_PREDICATES, Profile, near_names, swap_reason
from bddl.lexer import Forest, Group, Item, Word, group_words, read_words, words_in, words_of
from bddl.parser import likely_forms
from bddl.recovery import recover_parentheses


class TextEdit(NamedTuple):
    """A change of a text, and the slip that it corrects.

    Attributes:
        end: Offset behind the last one; equal to `start` for an insertion.
        text: What to write instead, or None when only the author knows.
    """

    start: int
    end: int
    text: str | None
    slip: Slip


@dataclass(frozen=True)
class TextDraft:
    """A text with its dialect and the objects that it may name.

    Attributes:
        objects: Category of each known object, or None when any name may be an object.
        given: Its forms and loose words, where they are known already; else they are read on demand.
    """

    text: str
    profile: Profile
    objects: Mapping[str, str] | None = None
    given: Forest | None = None

    @cached_property
    def words(self) -> list[Word]:
        return read_words(Source(self.text)) if self.given is None else words_of(self.given)

    @cached_property
    def forest(self) -> Forest:
        """Its forms and loose words; nothing when the parentheses do not match."""
        return self.balanced or ()

    @cached_property
    def balanced(self) -> Forest | None:
        """Its forms and loose words, or None when the parentheses do not match."""
        return group_words(read_words(Source(self.text))) if self.given is None else self.given

    @cached_property
    def groups(self) -> list[Group]:
        """Every form in it, outer ones first, from left to right."""
        found: list[Group] = []
        pending = [item for item in reversed(self.forest) if isinstance(item, Group)]
        while pending:
            found.append(group := pending.pop())
            pending.extend(item for item in reversed(group.items) if isinstance(item, Group))
        return found

    @cached_property
    def declared(self) -> frozenset[str]:
        """The names that a section `:objects` declares."""
        sections = (group for group in self.groups if group.head is not None and group.head.key == ":objects")
        return frozenset(word.text for group in sections for word in words_in(group.items))

    def quote(self, items: Iterable[Item]) -> str:
        """Return the text of some items, joined by blanks."""
        return " ".join(self.text[item.offset : item.end] for item in items)

    def edited(self, edits: Iterable[TextEdit]) -> TextDraft:
        """Return the draft after some changes; of changes that overlap, the one that begins first is made."""
        pieces: list[str] = []
        position = 0
        for edit in sorted(edits, key=lambda edit: (edit.start, edit.end)):
            if edit.start >= position and edit.text is not None:
                pieces += [self.text[position : edit.start], edit.text]
                position = edit.end
        return TextDraft("".join([*pieces, self.text[position:]]), self.profile, self.objects)


# Double quotes, single quotes, dashes, blanks of other widths, and the full-width forms of East Asian fonts.
_TYPOGRAPHY = {
    **dict.fromkeys("\u201c\u201d\u201e\u201f\u00ab\u00bb", '"'),
    **dict.fromkeys("\u2018\u2019\u201a\u201b", "'"),
    **dict.fromkeys("\u2010\u2011\u2012\u2013\u2014\u2015\u2212", "-"),
    **dict.fromkeys("\u00a0\u200b\u2009\u202f", " "),
    "\uff08": "(",
    "\uff09": ")",
    "\uff0c": ",",
}
_TYPOGRAPHIC = re.compile(f"[{''.join(_TYPOGRAPHY)}]")
_FENCE = re.compile(r"^[ \t]*(?:```|~~~)[^\n()]*$|`+", re.MULTILINE)
_ESCAPE = re.compile(r'\\[nrt"\\]')
_COMMENT = re.compile(r"(?<![^\s])(?://|#)[^\n]*")
_QUOTED = re.compile(r"""(["'])([^\s"'()]+)\1""")
_DOTS = re.compile(r"(?<![^\s()])(?:\.{3,}|…)(?![^\s()])")
_COMMA = re.compile(r",+[ \t]*")


def _replacing(
    pattern: re.Pattern[str], slip: Slip, text: Callable[[re.Match[str]], str | None]
) -> Callable[[TextDraft], Iterator[TextEdit]]:
    def rewrite(draft: TextDraft) -> Iterator[TextEdit]:
        for found in pattern.finditer(draft.text):
            yield TextEdit(*found.span(), text(found), slip)

    return rewrite


fix_characters = _replacing(_TYPOGRAPHIC, "typographic-character", lambda found: _TYPOGRAPHY[found.group()])
remove_fences = _replacing(_FENCE, "markdown-fence", lambda _: "")
remove_comments = _replacing(_COMMENT, "foreign-comment", lambda _: "")
unquote = _replacing(_QUOTED, "quoted-name", lambda found: found.group(2))
# Only the author knows what dots stand for.
find_ellipses = _replacing(_DOTS, "ellipsis", lambda _: None)


def open_json(draft: TextDraft) -> Iterator[TextEdit]:
    """Replace a JSON value by its formula, or the escapes of a JSON string by their characters."""
    text = draft.text
    start = re.search(r'[\[{"]', text)
    if start is not None and not text[: start.start()].strip("; \n").endswith("("):
        try:
            value, end = json.JSONDecoder().raw_decode(text, start.start())
        except (ValueError, RecursionError):
            value = None
        formula = formula_of_json(value)
        if formula:
            yield TextEdit(start.start(), end, formula, "json-text")
            return
    for found in _ESCAPE.finditer(text):
        yield TextEdit(*found.span(), '"' if found.group() == '\\"' else " ", "json-text")


def remove_commas(draft: TextDraft) -> Iterator[TextEdit]:
    """Replace commas inside forms by blanks."""
    for root in draft.forest:
        if isinstance(root, Group):
            for found in _COMMA.finditer(draft.text, root.offset, root.end):
                yield TextEdit(*found.span(), " ", "comma")


def remove_prose(draft: TextDraft) -> Iterator[TextEdit]:
    """Remove the words around the forms that look like BDDL, and the forms among them that do not."""
    groups = [item for item in draft.forest if isinstance(item, Group)]
    likely = likely_forms(groups, draft.profile, with_prose=len(groups) < len(draft.forest))
    for item in draft.forest:
        if likely and item not in likely:
            yield TextEdit(item.offset, item.end, "", "prose-around")


# Keys under which models put a formula, the predicate of an atom and its arguments.
_FORMULA_KEYS = ("goal", "formula", "condition", "goal_condition", "goal_state", "bddl", "init")
_HEAD_KEYS = ("predicate", "name", "op", "operator", "type")
_ARGUMENT_KEYS = ("args", "arguments", "objects", "params", "parameters", "operands")
_MOST_LEVELS = 50


def formula_of_json(value: object) -> str:
    """Return the formula of a JSON value, or "" when it has none.

    A string is the formula's own text. A list is a form when it begins with a word that is no formula, as in
    `["ontop", "a", "b"]`, and otherwise a list of formulas to be joined. An object has the formula under a key such
    as `goal`, or a predicate and its arguments.

    Example:
        >>> formula_of_json(["not", ["open", "refrigerator_0"]])
        '(not (open refrigerator_0))'
        >>> formula_of_json(["(open a)", "(open b)"])
        '(and (open a) (open b))'
    """
    text = _text(value, 0)
    return text if "(" in text else ""


def _text(value: object, level: int) -> str:
    if level > _MOST_LEVELS:
        return ""
    if isinstance(value, str):
        return value.strip()
    if isinstance(value, Mapping):
        return _object_text(value, level)
    if not isinstance(value, list) or not value:
        return ""
    parts = [_text(part, level + 1) for part in value]
    if not all(parts):
        return ""
    if "(" in parts[0]:
        return parts[0] if len(parts) == 1 else f"(and {' '.join(parts)})"
    return f"({' '.join(parts)})"


def _object_text(value: Mapping[object, object], level: int) -> str:
    for key in _FORMULA_KEYS:
        if key in value:
            return _text(value[key], level + 1)
    head = next((value[key] for key in _HEAD_KEYS if isinstance(value.get(key), str)), None)
    arguments = next((value[key] for key in _ARGUMENT_KEYS if isinstance(value.get(key), list)), None)
    if not isinstance(head, str) or not isinstance(arguments, list):
        return ""
    return _text([head, *arguments], level + 1)


# Operators that may stand between formulas, weakest first, with the connective that each one is.
_LEVELS: tuple[dict[str, str], ...] = (
    {"imply": "imply", "implies": "imply", "->": "imply", "=>": "imply", "→": "imply", "⇒": "imply"},
    {"or": "or", "|": "or", "||": "or", "∨": "or"},
    {"and": "and", "&": "and", "&&": "and", "∧": "and"},
)
_INFIX = {word: connective for level in _LEVELS for word, connective in level.items()}
_SYMBOLS = {"!", "~", "¬"}
_NEGATIONS = {"not", *_SYMBOLS}
# The name of a call: a word, and no tag or sign.
_CALLED = re.compile(r"[\w.\-:]+")
# More operands than this are no slip.
_MOST_OPERANDS = 200


def replace_symbols(draft: TextDraft) -> Iterator[TextEdit]:
    """Replace symbols at the head of a form or before one by their connectives."""
    for group in draft.groups:
        head = group.head
        if head is not None and not any(map(str.isalpha, head.key)) and head.key in FORM_SYNONYMS:
            yield TextEdit(head.offset, head.end, FORM_SYNONYMS[head.key], "operator-symbol")
    for items in _sequences(draft):
        for word, operand in pairwise(items[1:]):
            if isinstance(word, Word) and word.text in _SYMBOLS and isinstance(operand, Group):
                yield TextEdit(word.offset, operand.end, f"(not {draft.quote([operand])})", "operator-symbol")


def turn_calls(draft: TextDraft) -> Iterator[TextEdit]:
    """Turn calls such as `open(x)` into forms such as `(open x)`."""
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
    """Yield the edits from `(open(x))` to `(open x)`, which remove the inner parentheses."""
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
    """Move operators between formulas to the front; `not` binds strongest, then `and`, then `or`, then `imply`."""
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
    """Put atoms without parentheses into their own, in a connective or alone in the text; also a loose `not`."""
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
    """Give binders their parentheses and their hyphen; turn two variables in one into two quantifiers."""
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
    if len(words) == 3 and (words[1].kind == "HYPHEN" or words[1].key in ("in", ":", "of", "∈")):
        words = (words[0], words[2])
    if len(words) != 2 or words[0].kind != "VARIABLE" or words[1].kind != "NAME":
        return ""
    return f"({words[0].text} - {words[1].text})"


def _sequences(draft: TextDraft) -> list[Sequence[Item]]:
    return [items for items in (draft.forest, *(group.items for group in draft.groups)) if len(items) > 1]


def _is_bare_atom(draft: TextDraft, items: Sequence[Item]) -> bool:
    first = items[0] if items else None
    if not isinstance(first, Word) or not all(isinstance(item, Word) for item in items):
        return False
    spec = draft.profile.predicates.get(SYNONYM_OF.get(first.key, first.key))
    return spec is not None and spec.arity == len(items) - 1


def _prefix(draft: TextDraft, items: list[Item], level: int = 0) -> str:
    """Return the formula of operands with operators between them, or "" when they form none."""
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
    return reduce(lambda nested, text: f"(imply {text} {nested})", reversed(texts))


def _operand(draft: TextDraft, items: list[Item]) -> str:
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
    """Insert missing parentheses and remove surplus ones."""
    text = draft.text
    if draft.balanced is not None:
        for group in draft.groups:
            only = group.items[0] if len(group.items) == 1 else None
            if isinstance(only, Group) and only.head is not None and only.head.key in draft.profile.words:
                yield TextEdit(group.offset, group.end, draft.quote([only]), "extra-parenthesis")
        return
    reporter = Reporter(text)
    words = recover_parentheses(draft.words, draft.profile, reporter)
    kept = {word.offset for word in words if not word.invented}
    for word in draft.words:
        if word.offset not in kept:
            yield TextEdit(word.offset, word.end, "", "extra-parenthesis")
    for word in words:
        if word.invented:
            yield TextEdit(word.offset, word.offset, word.text, "missing-parenthesis")
    if not any(found.code in SLIP_OF_CODE for found in reporter.diagnostics):
        yield TextEdit(0, len(text), " ".join(word.text for word in words), "extra-parenthesis")


def join_formulas(draft: TextDraft) -> Iterator[TextEdit]:
    """Join several formulas in a row, in the text or in `:goal`, by one conjunction."""
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
    """Unwrap a lone `(:goal F)` or `(goal F)` to F, and `(:init (and F G))` to `(:init F G)`."""
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
    """Correct misspelt names of sections."""
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


_TRUTH = {"true": True, "false": False}
_ROBOT_WORDS = {"held", "holding", "grasped", "gripped", "in_hand", "in_gripper", "inhand", "picked_up", "grasping"}
_ROBOTS = {"robot", "agent", "gripper", "hand"}
# Heads of PDDL's forms with a condition, and of forms that BDDL lacks.
_CONDITION_SECTIONS = {":precondition", ":effect", ":condition"}
_PDDL = {
    "increase", "decrease", "assign", "scale-up", "scale-down", "preference", "forall-before", "at", "over",
    ">=", "<=", ">", "<", "+", "*", "/", "count", "total-cost", ":action", ":parameters", ":metric", ":durative-action",
}  # fmt: skip
_COMPARISONS = {"=", "==", "equal", "equals", "!=", "eq"}


def convert_truth_values(draft: TextDraft) -> Iterator[TextEdit]:
    """Remove truth values, `false` into a negation; mark comparisons of names, which BDDL lacks."""
    for group in draft.groups:
        head, items = group.head, group.items
        if head is None:
            continue
        last = items[-1]
        value = _TRUTH.get(last.key) if isinstance(last, Word) else None
        text = ""
        if head.key in _COMPARISONS and len(items) == 3:
            if value is not None and isinstance(items[1], Group):
                text = draft.quote(items[1:2])
            elif group.is_flat:
                yield TextEdit(group.offset, group.end, None, "equality")
        elif head.key in draft.profile.predicates and value is not None and len(items) > 2:
            text = f"({draft.quote(items[:-1])})"
        if text:
            yield TextEdit(group.offset, group.end, text if value else f"(not {text})", "truth-constant")


def convert_pddl(draft: TextDraft) -> Iterator[TextEdit]:
    """Unwrap conditions of PDDL sections and turn `when` into `imply`; mark numbers and actions."""
    for group in draft.groups:
        head = group.head
        if head is None:
            continue
        if head.key in _CONDITION_SECTIONS and len(group.items) == 2 and isinstance(group.items[1], Group):
            yield TextEdit(group.offset, group.end, draft.quote(group.items[1:]), "pddl-form")
        elif head.key == "when" and len(group.items) == 3:
            yield TextEdit(head.offset, head.end, "imply", "pddl-form")
        elif head.key in _PDDL and not (head.key in VAGUE_PREDICATES and group.is_flat):
            yield TextEdit(group.offset, group.end, None, "pddl-form")


def choose_predicates(draft: TextDraft) -> Iterator[TextEdit]:
    """Replace an unknown head by the predicate or connective that it means, where there is just one."""
    taken = {"define", "problem", *draft.profile.words, *(word.key for word in draft.words if word.kind == "SECTION")}
    for group in draft.groups:
        head, flat = group.head, group.is_flat
        if head is None or head.kind != "NAME" or head.key in taken:
            continue
        names = [word.text for word in words_in(group.items[1:])]
        formula = draft.profile.rewrite(head.key, names) if flat else ""
        if flat and head.key in _ROBOT_WORDS:
            held = [name for name in names if name.lower().rstrip("_0123456789") not in _ROBOTS]
            expressible = len(held) == 1 and "gripper" in draft.profile.builtin_objects
            text = f"(inside {held[0]} gripper)" if expressible else None
            yield TextEdit(group.offset, group.end, text, "robot-predicate")
        elif formula:
            yield TextEdit(group.offset, group.end, formula, "opposite-predicate")
        elif flat and head.key in VAGUE_PREDICATES:
            yield TextEdit(head.offset, head.end, None, "predicate-synonym")
        else:
            yield _rename_head(draft, head, flat)


def choose_objects(draft: TextDraft) -> Iterator[TextEdit]:
    """Replace an unknown name by the object that it means, where there is just one."""
    if draft.objects is None and not draft.declared:
        return
    known = {*(draft.objects or ()), *draft.profile.builtin_objects, *map(draft.profile.name_of, draft.declared)}
    bound, ordered = _bound_names(draft), sorted(known)
    for group in draft.groups:
        spec = draft.profile.predicates.get(group.head.key) if group.head is not None else None
        if spec is None:
            continue
        for position, item in enumerate(group.items[1:]):
            if not isinstance(item, Word) or item.text.removeprefix("?") in bound:
                continue
            room = position < spec.arity and spec.parameters[position] == ROOM
            name = draft.profile.name_of(item.text)
            if item.kind == "VARIABLE" and name in known and not draft.profile.free_marks:
                yield TextEdit(item.offset, item.end, name, "stray-question-mark")
            elif item.kind == "NAME" and name not in known and not room:
                yield _rename_object(item, ordered, draft)


def swap_roles(draft: TextDraft) -> Iterator[TextEdit]:
    """Swap arguments whose sizes show that they are in the wrong order."""
    objects = {**(draft.objects or {}), **draft.profile.builtin_objects}
    bound = _bound_names(draft)
    for group in draft.groups:
        words = words_in(group.items)
        if len(words) == len(group.items) == 3 and not bound.intersection(word.text.lstrip("?") for word in words):
            predicate, first, second = words
            if swap_reason(predicate.key, objects.get(first.text, first.text), objects.get(second.text, second.text)):
                swapped = f"({predicate.text} {second.text} {first.text})"
                yield TextEdit(group.offset, group.end, swapped, "swapped-roles")


def _rename_head(draft: TextDraft, head: Word, flat: bool) -> TextEdit:
    if not flat and near_names(head.text, ("define",)) and any(word.kind == "SECTION" for word in draft.words):
        return TextEdit(head.offset, head.end, "define", "misspelt-word")
    meant = SYNONYM_OF.get(head.key, "")
    if meant in draft.profile.words:
        slip: Slip = "predicate-synonym" if meant in draft.profile.predicates else "misspelt-word"
        return TextEdit(head.offset, head.end, meant, slip)
    near = near_names(head.text, draft.profile.words)
    if len(near) == 1 and (near[0] in draft.profile.predicates) == flat:
        return TextEdit(head.offset, head.end, near[0], "misspelt-word")
    return TextEdit(head.offset, head.end, None, "misspelt-word" if near else "invented-predicate")


def _rename_object(word: Word, known: Sequence[str], draft: TextDraft) -> TextEdit:
    """Return the edit of an unknown name, which is replaced only where no other object can be meant.

    A name with another number may be a second object of the kind. A name that the text uses already is taken.
    """
    same = [name for name in known if name.casefold() == word.text.casefold()]
    if len(same) == 1:
        return TextEdit(word.offset, word.end, same[0], "letter-case")
    near = near_names(word.text, known)
    if not near:
        return TextEdit(word.offset, word.end, None, "invented-object")
    number, own = (name[len(name.rstrip("0123456789")) :] for name in (word.text, near[0]))
    used = any(other.text == near[0] for other in draft.words)
    certain = len(near) == 1 and not used and number in ("", own)
    return TextEdit(word.offset, word.end, near[0] if certain else None, "object-variant")


def _bound_names(draft: TextDraft) -> frozenset[str]:
    quantified = (group for group in draft.groups if group.head is not None and group.head.key in QUANTIFIER_WORDS)
    items = (item for group in quantified for item in group.items[1:])
    words = (word for item in items for word in words_in(item.items if isinstance(item, Group) else [item]))
    return frozenset(word.text[1:] for word in words if word.kind == "VARIABLE")
