"""Numbers in a text, read as numbers: decimals, and the multiples of pi that angles are written as."""

from __future__ import annotations

import math
import re

_DECIMAL = r"\d+(?:\.\d*)?(?:e[+-]?\d+)?|\.\d+(?:e[+-]?\d+)?"
_NUMBER = re.compile(rf"(?P<sign>[+-]?)(?P<value>{_DECIMAL})", re.IGNORECASE)
_MULTIPLE = re.compile(
    rf"(?P<sign>[+-]?)(?:(?P<factor>{_DECIMAL})\*)?(?:np\.|math\.)?pi(?:/(?P<divisor>{_DECIMAL}))?", re.IGNORECASE
)


def read_number(text: str) -> float | None:
    """Returns the number that a word says, or None when it says none or one that is not finite.

    Example:
        >>> read_number("-1.5e-1"), read_number("-pi/2"), read_number("9**9")
        (-0.15, -1.5707963267948966, None)
    """
    found = _NUMBER.fullmatch(text)
    if found is not None:
        value = float(found["value"])
    else:
        found = _MULTIPLE.fullmatch(text)
        if found is None:
            return None
        divisor = float(found["divisor"] or 1.0)
        value = math.pi * float(found["factor"] or 1.0) / divisor if divisor else math.inf
    return (-value if found["sign"] == "-" else value) if math.isfinite(value) else None
