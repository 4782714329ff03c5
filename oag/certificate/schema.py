"""The form of a certificate, checked by the part of JSON Schema that `certificate.schema.json` uses.

Part of the independent check.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

_SCHEMA = Path(__file__).with_name("certificate.schema.json")
_TYPES: Mapping[str, tuple[type, ...]] = dict(
    string=(str,), integer=(int,), number=(int, float), boolean=(bool,), null=(type(None),)
)
# Returns the place inside a value that deviates from its form; None when none does.
_RuleCheck = Callable[[Any], str | None]


@cache
def schema_check() -> _RuleCheck:
    """Return the check by the schema: the place of the first deviation, None when there is none."""
    schema = json.loads(_SCHEMA.read_text(encoding="utf-8"))
    return _rule_check(schema, schema["$defs"])


def _rule_check(rule: Mapping[str, Any], defs: Mapping[str, Any]) -> _RuleCheck:
    if "$ref" in rule:
        return _rule_check(defs[rule["$ref"].rpartition("/")[2]], defs)
    if "anyOf" in rule:
        return _choice([_rule_check(part, defs) for part in rule["anyOf"]])
    if "const" in rule or "enum" in rule:
        legal = rule.get("enum", [rule.get("const")])
        return lambda value: None if type(value) is str and value in legal else ""
    if rule["type"] in ("array", "object"):
        return (_array if rule["type"] == "array" else _object)(rule, defs)
    names = [rule["type"]] if isinstance(rule["type"], str) else rule["type"]
    return _scalar(rule, frozenset(kind for name in names for kind in _TYPES[name]))


def _choice(choices: list[_RuleCheck]) -> _RuleCheck:
    def check(value: Any) -> str | None:
        for choice in choices:
            if choice(value) is None:
                return None
        return ""

    return check


def _scalar(rule: Mapping[str, Any], types: frozenset[type]) -> _RuleCheck:
    if "pattern" in rule:
        pattern = re.compile(rule["pattern"])
        return lambda value: None if type(value) is str and pattern.search(value) else ""
    if "minLength" in rule:
        shortest = rule["minLength"]
        return lambda value: None if type(value) is str and len(value) >= shortest else ""
    if "minimum" in rule:
        low, high = rule["minimum"], rule.get("maximum", math.inf)
        return lambda value: None if type(value) in types and low <= value <= high else ""
    return lambda value: None if type(value) in types else ""


def _array(rule: Mapping[str, Any], defs: Mapping[str, Any]) -> _RuleCheck:
    first = [_rule_check(part, defs) for part in rule.get("prefixItems", ())]
    rest = _rule_check(rule["items"], defs) if rule["items"] else None
    low = rule.get("minItems", 0)
    high = len(first) if rest is None else rule.get("maxItems", math.inf)

    def check(value: Any) -> str | None:
        if type(value) not in (list, tuple) or not low <= len(value) <= high:
            return ""
        for index, part in enumerate(value):
            fault = (rest or first[index])(part)
            if fault is not None:
                return f"[{index}]{fault}"
        return None

    return check


def _object(rule: Mapping[str, Any], defs: Mapping[str, Any]) -> _RuleCheck:
    named = {key: _rule_check(part, defs) for key, part in rule.get("properties", {}).items()}
    like = [(re.compile(key), _rule_check(part, defs)) for key, part in rule.get("patternProperties", {}).items()]
    other = _rule_check(rule["additionalProperties"], defs) if rule.get("additionalProperties") else None
    required, free = rule.get("required", ()), "additionalProperties" not in rule
    low, high = rule.get("minProperties", 0), rule.get("maxProperties", math.inf)

    def check(value: Any) -> str | None:
        if type(value) is not dict or not low <= len(value) <= high:
            return ""
        for key in required:
            if key not in value:
                return f".{key}"
        for key, part in () if free else value.items():
            each = named.get(key) or next((found for pattern, found in like if pattern.search(key)), other)
            fault = "" if each is None else each(part)
            if fault is not None:
                return f".{key}{fault}"
        return None

    return check
