"""Success by what varied: by each number that was drawn, in thirds of the episodes, or by its few values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import mannwhitneyu

from executor.bench.summary import Rate
from executor.datasets.work import drawn_values
from executor.envs.episodes import DrawnEpisode
from executor.geometry import wrap_angle
from executor.policies.judging.outcomes import EpisodeOutcome

PARTS = 3
"""Thirds: of fifty episodes about seventeen each, and an interval says how little that is."""


@dataclass(frozen=True, slots=True)
class AxisScore:
    """How success goes with one number that was drawn.

    Attributes:
        axis: Its name, with its unit.
        parts: Least and largest number, and success once, of each third of the episodes by that number, or of each of
            its values where these are three at most.
        p: How likely ranks of this number as different between successes and failures are where it makes no
            difference (Mann and Whitney's test); of many axes some are unlikely by chance. None where all came to
            the same.
    """

    axis: str
    parts: tuple[tuple[float, float, Rate], ...]
    p: float | None

    def to_json(self) -> dict[str, Any]:
        """Returns it as plain data."""
        parts = [{"from": low, "to": high, **rate.to_json()} for low, high, rate in self.parts]
        return {"axis": self.axis, "parts": parts, "p": self.p}


def drawn_numbers(episode: DrawnEpisode) -> dict[str, float]:
    """Returns name -> number of what was drawn for an episode: of its variation, of its first target, and how many
    things there are.

    Of the target: how far it is, in what direction and how turned as seen from the robot, its size, the numbers of its
    model, and 1 where its door turns about the right edge.
    """
    found: dict[str, float] = {"things": float(len(episode.scene.objects))}
    target, robot = episode.scene[episode.task.subtasks[0].target], episode.scene.robot
    ahead = np.array(target.position[:2]) - robot.position[:2]
    bearing_rad = wrap_angle(float(np.arctan2(ahead[1], ahead[0])) - robot.yaw_rad)
    found["target_distance_m"] = round(float(np.hypot(*ahead)), 4)
    found["target_bearing_deg"] = round(float(np.degrees(bearing_rad)), 2)
    w, x, y, z = target.orientation
    yaw_rad = float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    found["target_turned_deg"] = round(float(np.degrees(wrap_angle(yaw_rad - robot.yaw_rad))), 2)
    for side, size_m in zip(("depth", "width", "height"), target.extent_m, strict=True):
        found[f"target_{side}_m"] = round(size_m, 4)
    for name, value in target.parameters.items():
        if isinstance(value, int | float):
            found[f"target {name}"] = float(value)
    if "hinge" in target.parameters:
        found["target hinge_right"] = float(target.parameters["hinge"] == "right")
    if episode.unit is None:
        return found
    for axis, drawn in drawn_values(episode.unit, episode.scene, episode.strays).items():
        if axis == "distractors":
            found["distractors"] = float(len(drawn))
            continue
        for name, value in drawn.items():
            several = value if isinstance(value, Mapping) else {"": value}
            for part, number in several.items():
                if isinstance(number, int | float):
                    found[" ".join(word for word in (axis, name, part) if word)] = float(number)
    return found


def by_axis(outcomes: Sequence[EpisodeOutcome]) -> tuple[AxisScore, ...]:
    """Returns success by each number that was drawn for all of some episodes and is not the same in all."""
    if not outcomes:
        return ()
    shared = [axis for axis in outcomes[0].drawn if all(axis in outcome.drawn for outcome in outcomes)]
    good = np.array([outcome.success_once for outcome in outcomes])
    found = []
    for axis in shared:
        values = np.array([outcome.drawn[axis] for outcome in outcomes])
        if len(np.unique(values)) < 2:
            continue
        few = np.unique(values)
        alike = [np.flatnonzero(values == value) for value in few]
        thirds = np.array_split(np.argsort(values, kind="stable"), PARTS)
        parts = tuple(
            (float(values[part].min()), float(values[part].max()), Rate(int(good[part].sum()), len(part)))
            for part in (alike if len(few) <= PARTS else thirds)
            if len(part)
        )
        p = float(mannwhitneyu(values[good], values[~good]).pvalue) if good.any() and not good.all() else None
        found.append(AxisScore(axis, parts, None if p is None else round(p, 4)))
    return tuple(found)
