"""Sides of a place on which the arm never had room come last, and only those."""

from __future__ import annotations

import numpy as np

from executor.planning.collision import Hit
from executor.planning.place_search import COLLISIONS_OF_TAKEN_SIDE, HeadingStatistics
from executor.planning.stances import BaseCandidate, HandGoal

TABLE = [Hit("panda_link3", "table_0/table", -0.01), Hit("panda_hand", "bowl_0/bowl", -0.01)]
BOWL = [Hit("panda_hand", "bowl_0/bowl", -0.01), Hit("held object", "bowl_0/bowl", -0.01)]


def _goal(heading_rad: float, region: str = "hollow") -> HandGoal:
    return HandGoal(np.eye(4), heading_rad, region=region)


def _learned(hits: list[Hit], *, times: int = COLLISIONS_OF_TAKEN_SIDE) -> HeadingStatistics:
    sides = HeadingStatistics()
    for _ in range(times):
        sides.learn(_goal(1.0), hits)
    return sides


def test_a_side_is_taken_when_the_arm_met_something_in_all_of_many_postures() -> None:
    assert _learned(TABLE).is_taken(_goal(1.0))
    assert _learned(TABLE).is_taken(_goal(1.0 + 2 * np.pi)), "whole turns are no other side"
    assert not _learned(TABLE, times=COLLISIONS_OF_TAKEN_SIDE - 1).is_taken(_goal(1.0))
    assert not _learned(TABLE).is_taken(_goal(1.5)) and not _learned(TABLE).is_taken(_goal(1.0, "top"))


def test_what_the_hand_meets_says_nothing_and_one_free_posture_is_enough() -> None:
    assert not _learned(BOWL).is_taken(_goal(1.0))
    sides = _learned(TABLE)
    sides.learn(_goal(1.0), [])
    assert not sides.is_taken(_goal(1.0))


def test_no_candidate_is_lost_and_those_that_become_hopeless_on_the_way_come_last() -> None:
    sides = _learned(TABLE, times=COLLISIONS_OF_TAKEN_SIDE - 1)
    candidates = [BaseCandidate(_goal(heading), np.zeros(3), cost) for cost, heading in enumerate((1.0, 2.0, 1.0, 2.0))]
    order = []
    for candidate in sides.roomy_first(candidates):
        order.append(candidate.cost)
        sides.learn(candidate.goal, TABLE if candidate.goal.heading_rad == 1.0 else [])
    assert order == [0, 1, 3, 2]
