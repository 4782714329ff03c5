"""The sections that LIBERO adds to a problem, as text."""

from __future__ import annotations

from collections.abc import Iterable

from bddl.libero import LiberoProblem, Region, SceneStyle


def region_lines(region: Region) -> list[str]:
    """Returns the lines of one region, each attribute on a line of its own."""
    lines = [f"({region.name}", f"    (:target {region.target})"]
    if region.ranges:
        rows = [(each.x_min_m, each.y_min_m, each.x_max_m, each.y_max_m) for each in region.ranges]
        lines.append(f"    (:ranges ({' '.join(map(_row, rows))}))")
    if region.yaw_rad is not None:
        lines.append(f"    (:yaw_rotation ({_row(region.yaw_rad)}))")
    if region.rgba is not None:
        lines.append(f"    (:rgba {_row(region.rgba)})")
    return [*lines, ")"]


def style_line(style: SceneStyle) -> str:
    """Returns the line of one part of the scene."""
    said = {":floor": style.floor, ":wall": style.wall}
    parts = [f"({word} {value})" for word, value in said.items() if value is not None]
    return f"({' '.join([style.name, *parts])})"


def language_line(problem: LiberoProblem) -> str:
    """Returns the section with the instruction, as the file had it."""
    return f"(:language {problem.language})"


def _row(numbers: Iterable[float]) -> str:
    # repr gives back the same number when it is read.
    return f"({' '.join(map(repr, numbers))})"
