"""The flows that simple tasks have, open, close, pick, take out, place, and pick with place; their numbers are open.

Source: the paper's table of initial action flows. Departures: every flow begins with a navigation, every release ends
with a retreat, the hand is moved down at the end of every placing, and it backs out of what it has taken a thing out
of (docs/departures.md).
"""

from __future__ import annotations

from oag.primitives import Primitive

_REACH = (Primitive.NAVIGATE_TO_TARGET, Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP)
_RELEASE = (Primitive.UNGRASP, Primitive.RETREAT)

OPEN = (*_REACH, Primitive.ARTICULATE_OPEN, *_RELEASE)
CLOSE = (*_REACH, Primitive.ARTICULATE_CLOSE, *_RELEASE)
PICK = (*_REACH, Primitive.LIFT_EEF_UP)
# Within a compartment a lift takes nothing out of it: a thing is out when the hand has backed out with it.
TAKE_OUT = (*PICK, Primitive.RETREAT)
PLACE = (Primitive.NAVIGATE_TO_SUPPORT, Primitive.MOVE_BASE_FORWARD, Primitive.LIFT_EEF_DOWN, *_RELEASE)
# Picking up and putting down in one subtask; shorter flows do without the lift, which only the symbols allow.
TRANSPORT = (*PICK, *PLACE)

TEMPLATES = (OPEN, CLOSE, PICK, TAKE_OUT, PLACE, TRANSPORT)
