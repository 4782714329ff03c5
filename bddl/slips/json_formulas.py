"""Formulas that were written as JSON values, and how BDDL writes them."""

from __future__ import annotations

from collections.abc import Mapping

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
