"""Which step of the plan goes on: as foretold, but never past a grasp that holds nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from executor.datasets.store import EpisodeStore
from executor.policies.judging.outcomes import NEAR_M
from executor.policies.phases import NEAR_SLACK_M, OPENING_SLACK_M, PlanFollower
from executor.policies.trained import PolicyRecord
from executor.policies.windows import read_demonstrations, usual
from tests.executor.policies.conftest import small

pytestmark = pytest.mark.physics

PLAN = [17, 1, 2, 3, 7]
APPROACH, CONVERGE, GRASP, LIFT = 1, 2, 3, 4


@pytest.fixture(scope="module")
def record(picked: EpisodeStore) -> PolicyRecord:
    """Returns a policy of picking up."""
    return PolicyRecord.of(small(), 0, read_demonstrations([picked.path], small()))


def at(record: PolicyRecord, step: int) -> PlanFollower:
    """Returns who follows the plan, come as far as a step, with all that shows as demonstrations had it."""
    follower = PlanFollower(record)
    follower.begin(PLAN)
    for place in range(step):
        foretold(record, follower, PLAN[place + 1])
        follower.go_on(typical(record, PLAN[place]))
    assert record.primitives[follower.phase] == PLAN[step]
    return follower


def foretold(record: PolicyRecord, follower: PlanFollower, number: int) -> None:
    """Has a primitive foretold to go on."""
    logits = np.zeros(len(record.primitives))
    logits[record.primitives.index(number)] = 9.0
    follower.foretell(logits)


def typical(record: PolicyRecord, number: int) -> np.ndarray:
    """Returns what showed of a grasp where demonstrations had left a primitive."""
    phase = record.primitives.index(number)
    return (record.left[0][phase] + record.left[1][phase]) / 2


def test_demonstrations_say_what_shows_where_a_primitive_is_left(record: PolicyRecord) -> None:
    least, most = (bound[record.primitives.index(3)] for bound in record.left)
    # The fingers are neither shut nor open.
    assert 0.035 < least[0] <= most[0] < 0.055
    assert 0.0 <= least[1] <= most[1] < NEAR_M
    assert most[2] > 0.3  # The refrigerator's handle is elsewhere.
    assert (record.left[1][record.primitives.index(7)] > 100.0).all()  # What ends the plan is never left.


def test_a_primitive_is_left_where_demonstrations_left_it(record: PolicyRecord) -> None:
    follower = at(record, CONVERGE)
    shown = typical(record, 2)
    foretold(record, follower, 3)
    far = shown.copy()
    far[1] = record.left[1][record.primitives.index(2), 1] + 2 * NEAR_SLACK_M
    follower.go_on(far)
    assert record.primitives[follower.phase] == 2
    follower.go_on(shown)
    assert record.primitives[follower.phase] == 3


@pytest.mark.parametrize("step", [GRASP, LIFT])
def test_fingers_that_shut_on_nothing_begin_anew_at_the_approach(record: PolicyRecord, step: int) -> None:
    follower = at(record, step)
    foretold(record, follower, 7)
    empty = typical(record, 3)
    empty[0] = record.left[0][record.primitives.index(3), 0] - 2 * OPENING_SLACK_M
    follower.go_on(empty)
    assert record.primitives[follower.phase] == PLAN[APPROACH]


def test_fingers_that_still_close_have_not_missed(record: PolicyRecord) -> None:
    follower = at(record, GRASP)
    foretold(record, follower, 3)
    closing = typical(record, 3)
    closing[0] = 0.0
    follower.go_on(closing)
    assert record.primitives[follower.phase] == 3


def test_who_has_seen_corrections_goes_back_in_the_plan(record: PolicyRecord) -> None:
    for seen, expected in ((replace(record, takeovers=1), 17), (record, 3)):
        follower = at(seen, GRASP)
        foretold(seen, follower, 17)
        follower.go_on(typical(seen, 2))
        assert seen.primitives[follower.phase] == expected


def test_the_usual_posture_is_the_one_that_most_are_near_to() -> None:
    rng = np.random.default_rng(0)
    one, other = np.zeros(7), np.array([0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 1.0])
    near = [one + rng.normal(0.0, 0.05, (1, 7)) for _ in range(6)]
    far = [other + rng.normal(0.0, 0.05, (1, 7)) for _ in range(4)]
    assert usual([*far, *near], 1.0).tolist() == [False] * 4 + [True] * 6
    # Of two grasps both have to be usual; what begins behind the first is judged by the last.
    both = [np.concatenate([a, b]) for a, b in zip(near, [*near[:5], far[0]], strict=True)]
    assert usual([*both, near[0], far[1]], 1.0).tolist() == [True] * 5 + [False, True, False]
    assert usual([], 1.0).tolist() == [] and usual([np.zeros((0, 7))], 1.0).tolist() == [True]
