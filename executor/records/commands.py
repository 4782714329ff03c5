"""What the robot was told: enough to tell it the same again, physics step by physics step, without planning.

A motion is kept as the path that it was timed along, not as the thousands of drive targets that come of it: timing is a
function of the path (`executor.primitives.timing`), so a demonstration of a minute takes a few kilobytes.
"""

from __future__ import annotations

from dataclasses import dataclass

from executor.geometry import Array


@dataclass(frozen=True, slots=True)
class DriveCommand:
    """One thing that the robot was told to do, and for how many physics steps.

    Attributes:
        path: (N, 10) base and arm: waypoints of a motion, timed at `speed`; one row is where to be, at rest.
        finger_m: Where each finger shall be, from the middle.
        speed: Fraction of the speed limits along the path.
        followed: Physics steps for which the timed path was followed; not all of it where something ended the motion.
        stopped: Whether the robot then slowed down on the spot, rather than hold the end of the path.
        held: Physics steps for which it held still afterwards.
    """

    path: Array
    finger_m: float
    speed: float = 1.0
    followed: int = 0
    stopped: bool = False
    held: int = 0
