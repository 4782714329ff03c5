"""The four flows that simple tasks have, open, close, pick and place, and pick with place; their numbers are open.

Source: the paper's table of initial action flows. Departures: every flow begins with a navigation, every release ends
with a retreat, and the hand is moved down at the end of every placing (docs/departures.md).
"""

from __future__ import annotations

from oag.primitives import Primitive

_REACH = (Primitive.NAVIGATE_TO_TARGET, Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP)
_RELEASE = (Primitive.UNGRASP, Primitive.RETREAT)

OPEN = (*_REACH, Primitive.ARTICULATE_OPEN, *_RELEASE)
CLOSE = (*_REACH, Primitive.ARTICULATE_CLOSE, *_RELEASE)
PICK = (*_REACH, Primitive.LIFT_EEF_UP)
PLACE = (Primitive.NAVIGATE_TO_SUPPORT, Primitive.MOVE_BASE_FORWARD, Primitive.LIFT_EEF_DOWN, *_RELEASE)
# Picking up and putting down in one subtask; shorter flows do without the lift, which only the symbols allow.
TRANSPORT = (*PICK, *PLACE)

TEMPLATES = (OPEN, CLOSE, PICK, PLACE, TRANSPORT)
