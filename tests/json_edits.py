"""Changing one place of JSON data, for tests of what reads it."""

from __future__ import annotations

import copy
from typing import Any


def altered(data: dict[str, Any], path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    """Return the data with the value at one place replaced; `...` deletes it."""
    result = copy.deepcopy(data)
    at: Any = result
    for key in path[:-1]:
        at = at[key]
    if value is ...:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    return result
