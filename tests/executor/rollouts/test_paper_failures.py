"""The two failures that the paper's evolution did not solve, and the first one of its T1: all are solved here.

Source: the appendix "Failure Details and Analysis" and the evolution of T1. The flows have the paper's numbers.
"""

from __future__ import annotations

import pytest

from executor.rollouts.evolution_record import Evolution
from executor.rollouts.evolve import evolve
from executor.rollouts.rollout import RunConditions
from executor.sim.faults import Fault, NavigationOffset, PoseError
from oag.measurements import measurements_json
from tests.executor.rollouts.tasks import T1_PAPER_FLOWS, into_an_open_refrigerator, t3

pytestmark = [pytest.mark.physics, pytest.mark.slow]


def inserted_beside(seed: int, left_m: float) -> Evolution:
    """Evolves the insertion into a narrow refrigerator before which the base does not stop where it should."""
    faults: tuple[Fault, ...] = (NavigationOffset(0.0, left_m),)
    return evolve(
        into_an_open_refrigerator(T1_PAPER_FLOWS[1:3], width_m=0.46),
        seed=seed,
        conditions=RunConditions(faults=faults),
    )


def first_failure(told: Evolution, subtask: int) -> dict[str, object]:
    failure = told.stories[subtask].records[0].failure
    assert failure is not None and failure.kind.value == "unexpected-contact"
    return measurements_json(failure.measurements)


def test_an_arm_that_the_refrigerators_side_blocks_comes_free_by_a_step_back() -> None:
    """Case 1: "the lower link of the robotic arm collides with the left wall of the refrigerator"."""
    told = inserted_beside(16004, -0.14)
    found = first_failure(told, 1)
    assert str(found["mover"]).startswith("panda_")
    assert (found["other"], found["other_link"]) == ("refrigerator_0", "body")
    assert told.succeeded and told.revisions <= 2
    names = [action.primitive.name for action in told.stories[1].history.revisions[0].flow[:3]]
    assert names == ["NAVIGATE_TO_SUPPORT", "MOVE_BASE_BACKWARD", "NAVIGATE_TO_SUPPORT"]


def test_a_robot_that_runs_into_the_open_door_goes_another_way() -> None:
    """T1, subtask 3, iteration 0: "the robot collided with the open refrigerator door"."""
    told = inserted_beside(16004, 0.14)
    found = first_failure(told, 1)
    assert (found["other"], found["other_link"]) == ("refrigerator_0", "door")
    assert told.succeeded and told.revisions <= 2


@pytest.mark.parametrize(("seed", "dx_m", "dy_m"), [(16002, 0.0, 0.035), (16001, 0.03, -0.03)])
def test_an_apple_beside_its_bowl_is_moved_by_the_exact_offset(seed: int, dx_m: float, dy_m: float) -> None:
    """Case 2: "the VLM attempts to correct the drift, but lacks the precision to calculate the exact offset"."""
    told = evolve(t3(), seed=seed, conditions=RunConditions(faults=(PoseError("bowl_0", dx_m, dy_m),)))
    assert first_failure(told, 1)["other"] == "bowl_0"
    assert told.succeeded and told.revisions == 1
    revision = told.stories[1].history.revisions[0]
    moves = [action for action in revision.flow if action.primitive.name.startswith("MOVE_EEF")]
    sizes = [float(action.parameter) for action in moves if isinstance(action.parameter, float)]
    assert sum(size**2 for size in sizes) ** 0.5 == pytest.approx((dx_m**2 + dy_m**2) ** 0.5, abs=0.01)
