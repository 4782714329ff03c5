"""The exception for an option whose value cannot be used."""

from __future__ import annotations


class BadOption(ValueError):
    """An option has a value that cannot be used."""

    def __init__(self, option: str, value: object, expected: str) -> None:
        super().__init__(f"{option} {value}: expected {expected}")
