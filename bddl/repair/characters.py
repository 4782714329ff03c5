"""Slips around and between the words: typographic characters, fences, JSON, comments, quotes, commas, prose."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping

from bddl.reading.reader import likely_forms
from bddl.reading.words import Group
from bddl.repair.draft import TextDraft, TextEdit

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


def fix_characters(draft: TextDraft) -> Iterator[TextEdit]:
    """Typographic quotes, dashes, blanks and parentheses become those of a keyboard."""
    for found in _TYPOGRAPHIC.finditer(draft.text):
        yield TextEdit(*found.span(), _TYPOGRAPHY[found.group()], "typographic-character")


def remove_fences(draft: TextDraft) -> Iterator[TextEdit]:
    """Code fences and backticks go."""
    for found in _FENCE.finditer(draft.text):
        yield TextEdit(*found.span(), "", "markdown-fence")


def open_json(draft: TextDraft) -> Iterator[TextEdit]:
    """A JSON value becomes the formula that it says, and the escapes of a JSON string what they stand for."""
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


def convert_comments(draft: TextDraft) -> Iterator[TextEdit]:
    """Comments of other languages go."""
    for found in _COMMENT.finditer(draft.text):
        yield TextEdit(*found.span(), "", "foreign-comment")


def unquote(draft: TextDraft) -> Iterator[TextEdit]:
    """Words lose their quotation marks."""
    for found in _QUOTED.finditer(draft.text):
        yield TextEdit(*found.span(), found.group(2), "quoted-name")


def find_ellipses(draft: TextDraft) -> Iterator[TextEdit]:
    """Three dots are found; what they stand for, only the author knows."""
    for found in _DOTS.finditer(draft.text):
        yield TextEdit(*found.span(), None, "ellipsis")


def remove_commas(draft: TextDraft) -> Iterator[TextEdit]:
    """Commas inside forms become blanks."""
    for root in draft.forest:
        if isinstance(root, Group):
            for found in _COMMA.finditer(draft.text, root.offset, root.end):
                yield TextEdit(*found.span(), " ", "comma")


def remove_prose(draft: TextDraft) -> Iterator[TextEdit]:
    """Words around the forms that look like BDDL go, and so do forms among them that do not look like it."""
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
    """Returns the formula that a JSON value says, or "" when it says none.

    A string is the formula's own text. A list is a form when it begins with a word that is no formula, as in
    `["ontop", "a", "b"]`, and otherwise a list of formulas to be joined. An object has the formula under a key such
    as `goal`, or a predicate and its arguments.

    Args:
        value: What `json.loads` returned.

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
