"""Where words go: results to standard output, everything else to standard error."""

from __future__ import annotations

import sys
from collections.abc import Iterable

from rich.console import Console

from executor.files import json_text

# Without emoji=False "vllm:m: no reply" would be shown with a picture in place of ":m:".
OUT = Console(highlight=False, soft_wrap=True, emoji=False)
ERR = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)


def say(text: str, style: str | None = None) -> None:
    """Prints a line of the result."""
    OUT.print(text, style=style, markup=False)


def tell(text: str, style: str | None = None) -> None:
    """Prints a line beside the result, such as progress or a warning."""
    ERR.print(text, style=style, markup=False)


def tell_notes(notes: Iterable[str]) -> None:
    """Prints what a reader of the result has to know, a line each, beside the result."""
    for note in notes:
        tell(f"note: {note}")


def print_text(text: str) -> None:
    """Prints a finished text on standard output as it is, what its encoding lacks as an escape."""
    encoding = sys.stdout.encoding or "utf-8"
    sys.stdout.write(text.encode(encoding, "backslashreplace").decode(encoding))
    sys.stdout.flush()


def print_json(value: object) -> None:
    """Prints one JSON object on standard output."""
    print_text(json_text(value) + "\n")
