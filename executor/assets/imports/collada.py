"""What a Collada file says of its unit and of the axis that is up, which the mesh reader leaves to its caller."""

from __future__ import annotations

import re
from pathlib import Path

from executor.assets.imports.problems import ImportRefused

ENDING = ".dae"
_UP = re.compile(r"<up_axis>\s*([XYZ])_UP\s*</up_axis>")
# Within one element: from each of many that are not closed it would else be looked for to the end of the file.
_UNIT = re.compile(r"<unit\b[^<>]*\bmeter\s*=\s*[\"']([^\"']*)[\"']")
_UNITS_M = (1e-6, 1e3)


def unit_m(file: Path, text: str) -> float:
    """Returns the length of the file's unit in metres, 1 where it says nothing.

    Args:
        file: The file, for messages.
        text: What it holds.

    Raises:
        ImportRefused: It is no length.
    """
    found = _UNIT.search(text)
    if found is None:
        return 1.0
    try:
        length = float(found[1])
    except ValueError:
        length = 0.0
    if not _UNITS_M[0] <= length <= _UNITS_M[1]:
        raise ImportRefused(file, f"has a unit of {found[1][:40]!r} metres", "export it again")
    return length


def up_axis(file: Path, text: str) -> str:
    """Returns the axis that is up, "y" or "z"; "y" where the file says nothing, as its format has it.

    Args:
        file: The file, for messages.
        text: What it holds.

    Raises:
        ImportRefused: It is x.
    """
    found = _UP.search(text)
    if found is not None and found[1] == "X":
        raise ImportRefused(file, "has x up", "export it with y or z up")
    return "y" if found is None else found[1].lower()
