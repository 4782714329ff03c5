"""Values as models write them, where one reading is left: numbers as texts, formulas with slips, spellings of names."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import bddl

_NUMBER = re.compile(r"[-+]?(?:\d{1,15}\.?\d{0,15}|\.\d{1,15})(?:[eE][-+]?\d{1,2})?")
# A hyphen stands only after a word: elsewhere it is the sign of a number below zero.
_NUMBERED = re.compile(r"(?:(?:sub[ _-]?task|step|t)(?:-| - )?)?[ _#]*(\d{1,4})", re.IGNORECASE)
# Longest formula, and most levels of a list, that are read in another form than that of BDDL.
_LONGEST_FORMULA = 1_000
_DEEPEST_LIST = 12
_PARENTHESES: frozenset[bddl.Slip] = frozenset({"missing-parenthesis", "extra-parenthesis"})
# Slips of form, which leave one meaning. Misspelt words, wrong counts and swapped arguments go back as findings.
_SLIPS_OF_FORM: frozenset[bddl.Slip] = _PARENTHESES | {
    "bare-words", "comma", "foreign-comment", "function-notation", "goal-section", "infix-operator",
    "init-connective", "json-text", "markdown-fence", "operator-symbol", "opposite-predicate", "predicate-synonym",
    "quoted-name", "robot-predicate", "several-goals", "truth-constant", "typographic-character",
}  # fmt: skip


def plain_name(name: str) -> str:
    """Return the letters and digits of a field's name: `subTasks` and `sub-tasks` are `sub_tasks`."""
    return "".join(sign for sign in name.lower() if sign.isalnum())


def as_number(value: object) -> object:
    """Return the number that a text is, such as "0.4"; other values as they are."""
    if not isinstance(value, str) or _NUMBER.fullmatch(value.strip()) is None:
        return value
    text = value.strip()
    return int(text) if text.lstrip("+-").isdigit() else float(text)


def as_ordinal(value: object) -> object:
    """Return the number of a subtask or a step that a value names: "2", 2.0, "sub_task_2"; other values as they are."""
    if isinstance(value, float) and value.is_integer():
        return int(value)
    found = _NUMBERED.fullmatch(value.strip()) if isinstance(value, str) else None
    return value if found is None else int(found[1])


def as_formula(value: object) -> object:
    """Return the formula that a text or a list means as BDDL has it; a value without one certain meaning as it is."""
    text = _joined(value, _DEEPEST_LIST) if isinstance(value, list) else value
    if not isinstance(text, str) or not text.strip() or len(text) > _LONGEST_FORMULA or _is_formula(text):
        return value if text is None else text
    correction = bddl.correct(text)
    if correction is None or not _SLIPS_OF_FORM.issuperset(correction.slips):
        return text
    if not _PARENTHESES.isdisjoint(correction.slips):
        readings = set(_balanced(text))
        return readings.pop() if len(readings) == 1 else text
    return correction.text if _is_formula(correction.text) else text


def _is_formula(text: str) -> bool:
    try:
        bddl.parse_formula(text)
    except bddl.BDDLError:
        return False
    return True


def _joined(items: Sequence[object], depth: int) -> str | None:
    """Return a list as text: `["inside", "a", "b"]` is an atom, a list of formulas is their conjunction."""
    if not items:
        return ""
    first = items[0]
    is_form = isinstance(first, str) and first.isidentifier() and (len(items) > 1 or depth < _DEEPEST_LIST)
    parts = []
    for item in items:
        part = _joined(item, depth - 1) if isinstance(item, list) and depth else item
        if not isinstance(part, str) or not part.strip():
            return None
        parts.append(part)
    if is_form:
        return f"({' '.join(parts)})"
    return parts[0] if len(parts) == 1 else f"(and {' '.join(parts)})"


def _balanced(text: str) -> Iterator[str]:
    """Yield, normalised, every formula that a text is with one parenthesis more or less."""
    missing = text.count("(") - text.count(")")
    ends = [found.end() for found in re.finditer(r"[^\s()]+|\)", text)]
    if missing == 1:
        drafts = [f"{text[:end]}){text[end:]}" for end in ends]
    else:
        drafts = [text[: end - 1] + text[end:] for end in ends if text[end - 1] == ")" and missing == -1]
    for changed in drafts:
        try:
            yield bddl.format(bddl.parse_formula(changed))
        except bddl.BDDLError:
            continue
