"""Records of measurements, written as one object and told apart by its keys when it is read back."""

from __future__ import annotations

import json

import pytest

from oag.measurements import (
    FollowedInPart,
    GripLoss,
    GripMeasured,
    HandMeasured,
    JointMotion,
    Measurements,
    MoveMeasured,
    OutOfReach,
    ReleaseMeasured,
    RetreatMeasured,
    RobotStall,
    SideEffect,
    StageCount,
    SupportDrive,
    TargetDrive,
    TimeUp,
    TooWide,
    UnmeantContact,
    Unplanned,
    measurements_json,
    read_measurements,
)

_MOTION = JointMotion("hinge", "rigid arc", 0.0, 1.0, 0.9, 1.2)
_RECORDS: tuple[Measurements, ...] = (
    (_MOTION,),
    (JointMotion("hinge", "push", 0.0, 1.0, 0.9, 1.2, (_MOTION, _MOTION)),),
    (GripMeasured("push"),),
    (GripMeasured(None, 2, 0.05, 0.04, 11.0),),
    (ReleaseMeasured(0.01, 0.02),),
    (RetreatMeasured(True),),
    (RetreatMeasured(None, 30, 40),),
    (TargetDrive(1.0, 2.0, 90.0, 12.0, 3),),
    (SupportDrive("table_0"),),
    (SupportDrive("table_0", 1.5, "top", 12.0, None, 0.01),),
    (HandMeasured((0.1, 0.2, 0.3), 0.01),),
    (MoveMeasured(asked_m=0.1, eef_moved_m=0.09), UnmeantContact("hand", "table_0", "top", 12.0)),
    (MoveMeasured(asked_deg=30.0, eef_moved_m=0.09, set_down=True),),
    (OutOfReach(0.1, 0.8, 0.3, ("panda_joint4",)),),
    (FollowedInPart(0.1, 0.5),),
    (GripLoss(time_s=1.0),),
    (GripLoss(slip_m=0.01, time_s=1.0),),
    (SideEffect("bowl_0", 0.1, True),),
    (RobotStall(0.1, 2.0, 3.0),),
    (TimeUp(30.0, 31.0),),
    (TooWide(0.1, 0.056, 0.03, 0.05),),
    (StageCount(2),),
    (JointMotion("hinge", "push", 0.0, 1.0, 0.9, 1.2), StageCount(2)),
    (Unplanned(target="glass_0", stances_tried=60, in_the_way={"table_0": 7}),),
    (Unplanned(target="glass_0", support="table_0"),),
    (Unplanned(support="table_0", in_the_way=("wall", "chair_0")),),
)


@pytest.mark.parametrize("records", _RECORDS, ids=repr)
def test_records_are_read_back_as_what_they_were(records: Measurements) -> None:
    assert read_measurements(json.loads(json.dumps(measurements_json(records)))) == records


def test_values_of_no_known_form_are_left_out() -> None:
    assert read_measurements({"stages": "two", "limit_s": [], "time_s": {}, "smell": "burnt"}) == ()
