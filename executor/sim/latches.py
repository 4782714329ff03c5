"""The latches of push buttons: pressed past its click, a button stays in; pressed past it again, it comes out.

The spring of a button is a drive towards where it rests. Which of its two places that is, the drive's target says, so
that it is part of every packed state. The latch changes once a press: the button has to come back before it does again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from executor.assets.model import Asset, Control


class Latch:
    """The latch of one button.

    Args:
        articulation: The engine's, of the button's object.
        index: Of the button among its joints.
        control: The button.
    """

    def __init__(self, articulation: Any, index: int, control: Control) -> None:
        self._articulation, self._index, self._control = articulation, index, control
        self._joint = articulation.active_joints[index]
        self._came_back_m = (control.set_to + control.click) / 2
        self._armed = self._is_before_click()

    @property
    def is_in(self) -> bool:
        """Whether the button rests where it is latched."""
        return float(self._joint.drive_target[0]) > self._control.set_to / 2

    def update(self) -> None:
        """Change the latch if the button has passed its click since the last step."""
        position = float(self._articulation.get_qpos()[self._index])
        if position < self._came_back_m:
            self._armed = True
        elif self._armed and position >= self._control.click:
            self._armed = False
            self._joint.set_drive_target(0.0 if self.is_in else self._control.set_to)

    def put(self, position: float) -> None:
        """Set the latch to what a button has at a position [m], at rest."""
        self.forget()
        self._joint.set_drive_target(self._control.set_to if self._control.is_on(position) else 0.0)

    def forget(self) -> None:
        """Forget how the button came to where it is now.

        A packed state has its position and its latch, and not whether this press has changed the latch. Beyond the
        click it has: the latch changes in the step that passes it.
        """
        self._armed = self._is_before_click()

    def _is_before_click(self) -> bool:
        return float(self._articulation.get_qpos()[self._index]) < self._control.click


def latches_of(articulations: Iterable[tuple[str, Any]], assets: Mapping[str, Asset]) -> dict[tuple[str, str], Latch]:
    """Return the latches of all buttons by object and joint.

    Args:
        articulations: Ids of objects with the engine's articulation of each.
        assets: What they are built of.
    """
    return {
        (name, joint.name): Latch(articulation, index, joint)
        for name, articulation in articulations
        for index, joint in enumerate(assets[name].joints)
        if isinstance(joint, Control) and joint.is_button
    }
