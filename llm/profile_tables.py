"""Reads profiles.toml, and a file of the user's own over it; a faulty table is named with its place."""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, TypeAlias

from bddl.boundedfile import read_bounded_text
from llm.errors import ModelConfigError
from llm.transport import MODES

# Names a file of the same form as profiles.toml, whose providers and models come before the built-in ones.
OWN_PROFILES = "SCENE2DEMO_PROFILES"

Table: TypeAlias = dict[str, Any]

_NUMBER = (int, float)
_KINDS: Mapping[str, tuple[type, ...]] = {
    "base_url": (str,),
    "base_url_variable": (str,),
    "key_variable": (str,),
    "key_required": (bool,),
    "mode": (str,),
    "system_role": (str,),
    "max_images": (int,),
    "stream": (bool,),
    "timeout_s": _NUMBER,
    "max_tokens_field": (str,),
    "send_temperature": (bool,),
    "account_headers": (bool,),
    "any_model": (bool,),
    "extra_body": (dict,),
    "price": (dict,),
}
_CHOICES: Mapping[str, tuple[str, ...]] = {
    "mode": MODES,
    "system_role": ("system", "user"),
    "max_tokens_field": ("max_tokens", "max_completion_tokens"),
}


def tables(own: Path | None = None) -> dict[str, Table]:
    """Returns provider -> settings, with the models' settings under "models".

    Args:
        own: A file of profiles that come before the built-in ones; default is what SCENE2DEMO_PROFILES names, if set.

    Raises:
        ModelConfigError: The file cannot be read, or a setting in it is unknown or of the wrong kind.
    """
    named = own or (Path(os.environ[OWN_PROFILES]) if os.environ.get(OWN_PROFILES) else None)
    if named is None:
        return _built_in()
    try:
        text = read_bounded_text(named)
    except (OSError, UnicodeDecodeError) as error:
        raise ModelConfigError(str(named), f"the file of profiles cannot be read: {error}") from error
    merged = {name: dict(table) for name, table in _built_in().items()}
    for provider, table in _checked(text, str(named)).items():
        below = merged.get(provider, {})
        merged[provider] = below | table | {"models": {**below.get("models", {}), **table.get("models", {})}}
    return merged


@cache
def _built_in() -> dict[str, Table]:
    """Returns the tables of profiles.toml."""
    return _checked((resources.files("llm") / "profiles.toml").read_text(encoding="utf-8"), "profiles.toml")


def _checked(text: str, file: str) -> dict[str, Table]:
    """Returns the tables of a file of profiles, or raises a ModelConfigError that says where it is faulty."""
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ModelConfigError(file, f"no TOML: {error}") from error
    for provider, table in tables.items():
        if not isinstance(table, dict) or not isinstance(table.get("models", {}), dict):
            raise ModelConfigError(file, f"[{provider}] is a table of settings, with a table of models")
        _check_settings({name: value for name, value in table.items() if name != "models"}, f"[{provider}]", file)
        for model, settings in table.get("models", {}).items():
            where = f'[{provider}.models."{model}"]'
            if not isinstance(settings, dict):
                raise ModelConfigError(file, f"{where} is a table of settings")
            _check_settings(settings, where, file)
    return tables


def _check_settings(settings: Table, where: str, file: str) -> None:
    """Raises a ModelConfigError for a setting that is unknown or has a value that it cannot have."""
    for name, value in settings.items():
        if name not in _KINDS:
            near = get_close_matches(name, _KINDS, n=1)
            advice = f"Did you mean {near[0]}? " if near else ""
            raise ModelConfigError(
                file, f"{where} has an unknown setting {name!r}", f"{advice}Settings are {', '.join(_KINDS)}", near=near
            )
        wanted = _fault(name, value)
        if wanted:
            raise ModelConfigError(file, f"{where} {name} is {wanted}, not {str(value)[:60]!r}")


def _fault(name: str, value: object) -> str:
    """Returns what a setting has to be where its value is not that, else nothing."""
    kinds = _KINDS[name]
    if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
        return {str: "a text", bool: "true or false", dict: "a table", int: "a number"}[kinds[0]]
    if name in _CHOICES and value not in _CHOICES[name]:
        return f"one of {', '.join(_CHOICES[name])}"
    if name == "timeout_s" and not 0 < float(str(value)) < math.inf:
        return "a number of seconds above 0"
    if name == "max_images" and isinstance(value, int) and value < 0:
        return "a number, 0 or above"
    if name == "price" and isinstance(value, dict) and not _is_price(value):
        return "{ input = DOLLARS, output = DOLLARS } per million tokens"
    return ""


def _is_price(value: dict[str, object]) -> bool:
    """Returns whether a table is a price."""
    return set(value) == {"input", "output"} and all(
        isinstance(item, _NUMBER) and not isinstance(item, bool) and 0 <= item < math.inf for item in value.values()
    )
