"""Which step of the plan goes on: as foretold, but never past a grasp that holds nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from executor.data.episode import Episode
from executor.data.store import EpisodeStore
from executor.learn.demonstrations import (
    MOST_GRASP_MODES,
    cluster_grasp_modes,
    grasp_modes_per_step,
    read_demonstrations,
)
from executor.learn.evaluation import NEAR_M
from executor.learn.phases import BACK_S, EMPTY_SHARE, NEAR_SLACK_M, OVERDUE, PATIENCE_S, PlanFollower
from executor.learn.policy_record import PolicyRecord
from tests.executor.learn.conftest import small

pytestmark = pytest.mark.physics

PLAN = [17, 1, 2, 3, 7]
APPROACH, CONVERGE, GRASP, LIFT = 1, 2, 3, 4
EXECUTE = 4
STAYS = np.zeros(64)  # No step looks likelier than another now.
LONG = np.full(3, 60.0, np.float32)  # For how long demonstrations were in each of three steps.


@pytest.fixture(scope="module")
def record(picked: EpisodeStore) -> PolicyRecord:
    """Return a policy of picking up."""
    return PolicyRecord.of(small(), 0, read_demonstrations([picked.path], small()))


def at(record: PolicyRecord, step: int) -> PlanFollower:
    """Return who follows the plan, come as far as a step, with all that shows as demonstrations had it."""
    follower = PlanFollower(record, EXECUTE)
    follower.begin(PLAN)
    for place in range(step):
        foretold(record, follower, PLAN[place + 1])
        follower.go_on(STAYS, typical(record, PLAN[place]))
    assert record.steps[follower.phase] == PLAN[step]
    return follower


def foretold(record: PolicyRecord, follower: PlanFollower, number: int) -> None:
    """Has a primitive foretold to go on."""
    logits = np.zeros(len(record.steps))
    logits[record.steps.index(number)] = 9.0
    follower.note_prediction(logits)


def typical(record: PolicyRecord, number: int) -> np.ndarray:
    """Return what showed of a grasp where demonstrations had left a primitive."""
    phase = record.steps.index(number)
    return (record.exit_bounds[0][phase] + record.exit_bounds[1][phase]) / 2


def test_demonstrations_say_what_shows_where_a_primitive_is_left(record: PolicyRecord) -> None:
    least, most = (bound[record.steps.index(3)] for bound in record.exit_bounds)
    # The fingers are neither shut nor open.
    assert 0.035 < least[0] <= most[0] < 0.055
    assert (least[1:4] <= most[1:4]).all() and np.abs([least[1:4], most[1:4]]).max() < NEAR_M
    assert (most[4:7] > 100.0).all()  # Nothing takes hold of the refrigerator's handle.
    assert (record.exit_bounds[1][record.steps.index(7)] > 100.0).all()  # What ends the plan is never left.


def test_a_primitive_is_left_where_demonstrations_left_it(record: PolicyRecord) -> None:
    follower = at(record, CONVERGE)
    shown = typical(record, 2)
    foretold(record, follower, 3)
    far = shown.copy()
    far[1] = record.exit_bounds[1][record.steps.index(2), 1] + 2 * NEAR_SLACK_M
    follower.go_on(STAYS, far)
    assert record.steps[follower.phase] == 2
    follower.go_on(STAYS, shown)
    assert record.steps[follower.phase] == 3


def test_a_hand_that_has_arrived_takes_hold_at_once(record: PolicyRecord) -> None:
    follower = at(record, CONVERGE)
    foretold(record, follower, 2)
    there, far = typical(record, 2), typical(record, 2)
    far[1] = record.exit_bounds[1][record.steps.index(2), 1] + 2 * NEAR_SLACK_M
    done = np.zeros(len(record.steps))
    done[record.steps.index(3)] = 9.0
    follower.go_on(done, far)
    assert record.steps[follower.phase] == 2
    follower.go_on(done, there)
    assert record.steps[follower.phase] == 3


@pytest.mark.parametrize("step", [GRASP, LIFT])
def test_fingers_that_shut_on_nothing_begin_anew_at_the_approach(record: PolicyRecord, step: int) -> None:
    follower = at(record, step)
    foretold(record, follower, 7)
    empty = typical(record, 3)
    empty[0] = 0.9 * EMPTY_SHARE * record.exit_bounds[0][record.steps.index(3), 0]
    follower.go_on(STAYS, empty)
    assert record.steps[follower.phase] == PLAN[APPROACH]


def test_a_crooked_grasp_begins_anew_after_a_while(record: PolicyRecord) -> None:
    follower = at(record, GRASP)
    crooked = typical(record, 3)
    crooked[0] = 0.07
    looks = 0
    while record.steps[follower.phase] == 3:
        foretold(record, follower, 7)
        follower.go_on(STAYS, crooked)
        looks += 1
    assert record.steps[follower.phase] == PLAN[APPROACH]
    assert PATIENCE_S < looks * EXECUTE / record.rate_hz <= PATIENCE_S + EXECUTE / record.rate_hz


@pytest.mark.parametrize("least, most", [(0.6, 1.0), (0.9, 1.0), (0.4, 0.5)])
def test_a_door_is_left_open_as_far_as_demonstrations_left_it_or_farther_or_after_a_while(
    record: PolicyRecord, least: float, most: float
) -> None:
    primitives = (3, 4, 5)
    exit_bounds = [np.full((3, 8), bound, np.float32) for bound in (-1.0, 1.0)]
    exit_bounds[0][1, 7], exit_bounds[1][1, 7] = least, most
    follower = PlanFollower(
        replace(record, steps=primitives, exit_bounds=(exit_bounds[0], exit_bounds[1]), longest_s=LONG), EXECUTE
    )
    follower.begin((4, 5))
    shown, looks = np.full(8, 0.7), 0
    while follower.phase == 1:
        follower.note_prediction(np.array([0.0, 0.0, 9.0]))
        follower.go_on(STAYS, shown)
        looks += 1
    assert looks == (1 if least < 0.7 else int(PATIENCE_S * record.rate_hz / EXECUTE) + 1)


def test_a_plan_that_left_a_door_shut_begins_anew(record: PolicyRecord) -> None:
    primitives = (3, 4, 5)
    exit_bounds = [np.full((3, 8), bound, np.float32) for bound in (-1.0, 1.0)]
    exit_bounds[0][1, 7], exit_bounds[1][1, 7] = 0.6, 1.0
    for share, begins in ((0.7, False), (0.3, True)):
        follower = PlanFollower(
            replace(record, steps=primitives, exit_bounds=(exit_bounds[0], exit_bounds[1]), longest_s=LONG), EXECUTE
        )
        follower.begin((3, 4, 5))
        shown = np.full(8, share)
        seen = []
        for _ in range(int((BACK_S + 4 * PATIENCE_S) * record.rate_hz / EXECUTE)):
            follower.note_prediction(np.array([0.0, 5.0, 9.0]))
            follower.go_on(STAYS, shown)
            seen.append(follower.phase)
        assert 2 in seen and (0 in seen[seen.index(2) :]) is begins


def test_fingers_that_still_close_have_not_missed(record: PolicyRecord) -> None:
    follower = at(record, GRASP)
    foretold(record, follower, 3)
    closing = typical(record, 3)
    closing[0] = 0.0
    follower.go_on(STAYS, closing)
    assert record.steps[follower.phase] == 3


def test_who_has_learned_from_corrections_begins_anew_as_the_planner_does(record: PolicyRecord) -> None:
    empty = typical(record, 3)
    empty[0] = 0.0
    # The planner opens the hand first; a policy that has seen that does so, and drives then.
    opening = replace(
        record,
        takeovers=1,
        steps=(*record.steps, 5),
        exit_bounds=(
            np.concatenate([record.exit_bounds[0], record.exit_bounds[0][:1]]),
            np.concatenate([record.exit_bounds[1], record.exit_bounds[1][:1]]),
        ),
        longest_s=np.append(record.longest_s, record.longest_s[:1]),
    )
    for seen, expected in ((record, [1]), (replace(record, takeovers=1), [17]), (opening, [5, 17])):
        follower = at(seen, GRASP)
        foretold(seen, follower, 7)
        follower.go_on(STAYS, empty)
        begun = [seen.steps[follower.phase]]
        assert follower.restarts == 1
        foretold(seen, follower, expected[-1])
        follower.go_on(STAYS[: len(seen.steps)], typical(record, 17))
        begun.append(seen.steps[follower.phase])
        assert list(dict.fromkeys(begun)) == expected
    follower.begin(PLAN)
    assert follower.restarts == 0


def test_who_goes_on_with_a_later_subtask_does_not_begin_anew_in_one_that_is_done(record: PolicyRecord) -> None:
    later = [100 + step for step in PLAN]
    twice = replace(
        record,
        takeovers=1,
        steps=(*record.steps, *(100 + step for step in record.steps)),
        exit_bounds=(np.tile(record.exit_bounds[0], (2, 1)), np.tile(record.exit_bounds[1], (2, 1))),
        longest_s=np.tile(record.longest_s, 2),
    )
    follower = PlanFollower(twice, EXECUTE)
    follower.begin(later)
    assert twice.steps[follower.phase] == 117
    empty = typical(record, 3)
    empty[0] = 0.0
    for place in (1, 2, 3):
        foretold(twice, follower, later[place])
        follower.go_on(np.zeros(len(twice.steps)), typical(twice, later[place - 1]))
    foretold(twice, follower, 107)
    follower.go_on(np.zeros(len(twice.steps)), empty)
    assert follower.restarts == 1 and twice.steps[follower.phase] == 117


@pytest.mark.parametrize("off_m, looks_s", [(0.0, 0.0), (0.1, PATIENCE_S)])
def test_a_drive_is_left_where_demonstrations_left_it_or_after_a_while(
    record: PolicyRecord, off_m: float, looks_s: float
) -> None:
    follower, looks = at(record, 0), 0
    standing = typical(record, 17)
    standing[1] += off_m
    while record.steps[follower.phase] == 17:
        foretold(record, follower, 1)
        follower.go_on(STAYS, standing)
        looks += 1
    assert looks == int(looks_s * record.rate_hz / EXECUTE) + 1
    assert follower.restarts == 0, "who has tried for long enough goes on"


@pytest.mark.parametrize("number, opening_m, then", [(5, 0.03, 7), (17, 0.03, 7), (3, 0.055, 7), (3, 0.03, 1)])
def test_what_takes_far_longer_than_demonstrations_took_is_left_or_begun_anew(
    record: PolicyRecord, number: int, opening_m: float, then: int
) -> None:
    steps = tuple(sorted((1, number, 7)))
    exit_bounds = [np.full((3, 8), bound, np.float32) for bound in (-1.0, 1.0)]
    exit_bounds[0][:, 0] = exit_bounds[1][:, 0] = 0.055
    longest_s = np.full(3, 60.0, np.float32)
    longest_s[steps.index(number)] = 3.0
    follower = PlanFollower(
        replace(record, steps=steps, exit_bounds=(exit_bounds[0], exit_bounds[1]), longest_s=longest_s),
        EXECUTE,
    )
    follower.begin((1, number, 7))
    shown, looks = np.full(8, opening_m), 0
    follower.note_prediction(np.eye(3)[steps.index(number)])
    follower.go_on(STAYS[:3], np.full(8, 0.055))
    while follower.phase == steps.index(number):
        follower.note_prediction(STAYS[:3])
        follower.go_on(STAYS[:3], shown)
        looks += 1
    assert looks == int(OVERDUE * 3.0 * record.rate_hz / EXECUTE) + 1
    assert steps[follower.phase] == then and follower.restarts == (then == 1)


def test_ways_of_grasping_are_told_apart_the_usual_one_first() -> None:
    rng = np.random.default_rng(0)
    one, other = np.zeros(7), np.array([0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 1.0])
    near = [one + rng.normal(0.0, 0.05, (1, 7)) for _ in range(6)]
    far = [other + rng.normal(0.0, 0.05, (1, 7)) for _ in range(4)]
    assert cluster_grasp_modes([*far, *near]).tolist() == [1] * 4 + [0] * 6
    # Two grasps have to be alike both; what begins behind the first is judged by the last.
    both = [np.concatenate([a, b]) for a, b in zip(near, [*near[:5], far[0]], strict=True)]
    assert cluster_grasp_modes([*both, near[0], far[1]]).tolist() == [0] * 5 + [1, 0, 1]
    assert cluster_grasp_modes([]).tolist() == [] and cluster_grasp_modes([np.zeros((0, 7))]).tolist() == [0]
    scattered = [np.full((1, 7), float(place)) for place in range(2 * MOST_GRASP_MODES)]
    assert max(cluster_grasp_modes(scattered)) == MOST_GRASP_MODES - 1


def test_where_nothing_is_grasped_ways_are_those_of_letting_go() -> None:
    def episode(placed: float) -> Episode:
        """Grasp alike, and then puts down in one of two postures."""
        primitives = np.array([17, 3, 18, 5, 13])
        state = np.zeros((5, 20), np.float32)
        state[3:, 3:10] = placed
        columns = {"primitive_index": primitives, "observation.state": state}
        return Episode(0, columns, {}, {})

    placings = (0.0, 0.0, 2.0, 0.0)
    going_on = np.array([17, 3, 118, 105, 113])
    found = grasp_modes_per_step([episode(placed) for placed in placings], [going_on] * 4).reshape(4, 5)
    assert (found[:, :2] == 0).all() and found[:, 2:].tolist() == [[0] * 3, [0] * 3, [1] * 3, [0] * 3]


def test_who_goes_on_with_a_door_has_the_usual_way() -> None:
    opening = np.array([3, 4, 5, 7])
    state = np.zeros((4, 20), np.float32)
    state[2:, 3:10] = 2.0
    usual = Episode(0, {"primitive_index": opening, "observation.state": state}, {}, {})
    goes_on = Episode(1, {"primitive_index": opening[1:], "observation.state": state[1:]}, {}, {})
    assert not grasp_modes_per_step([usual, goes_on, usual], [opening, opening[1:], opening]).any()
