"""A subtask's exact starting point: everything that the physics and the executor need to go on from there.

At every subtask boundary the world is settled, packed, built anew and unpacked, and the run goes on from that. So a
retry or a replay from a checkpoint is the same to the last bit as the run that made it: contact caches, which cannot
be packed, are empty in both.
"""

from __future__ import annotations

import base64
import json
from dataclasses import asdict, dataclass

import numpy as np

from executor.primitives.control import Controller, Tick
from executor.world.physics import STANDARD, Physics
from executor.world.world import World
from oag import Scene


class CheckpointError(ValueError):
    """Bytes that are not a checkpoint of this version."""


VERSION = 2


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A subtask's start.

    Attributes:
        packed: The physics engine's state.
        target: (10,) joint targets.
        finger_target_m: Target of each finger.
        steps: Physics steps since the rollout began.
        held: Id of the item in the gripper, or None.
        gripped: Id of the fixture whose handle is in the gripper, or None.
        lifted_from: Contacts that the held item had where it was taken, as pairs of bodies.
        released: Pairs of bodies that the fingers may touch while they leave, from the subtask before.
        state_hash: Hash of everything recorded up to here.
    """

    packed: bytes
    target: tuple[float, ...]
    finger_target_m: float
    steps: int
    held: str | None
    gripped: str | None
    lifted_from: tuple[tuple[str, str], ...]
    released: tuple[tuple[str, str], ...]
    state_hash: str

    def to_bytes(self) -> bytes:
        """Returns the checkpoint as UTF-8 JSON."""
        fields = asdict(self) | {"packed": base64.b64encode(self.packed).decode(), "version": VERSION}
        return json.dumps(fields).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> Checkpoint:
        """Returns the checkpoint in bytes written by `to_bytes`.

        Raises:
            CheckpointError: The bytes are something else.
        """
        try:
            fields = json.loads(data)
            version = fields.pop("version")
            fields["packed"] = base64.b64decode(fields["packed"])
            fields["target"] = tuple(fields["target"])
            for contacts in ("lifted_from", "released"):
                fields[contacts] = tuple((a, b) for a, b in fields[contacts])
            found = cls(**fields)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise CheckpointError(f"not a checkpoint: {error}") from error
        if version != VERSION:
            raise CheckpointError(f"checkpoint version {version}, this program reads {VERSION}")
        return found

    def restore(self, scene: Scene, after_step: Tick, physics: Physics = STANDARD) -> tuple[World, Controller]:
        """Returns a fresh world in this state, and a controller that holds it there."""
        world = World(scene, physics=physics)
        world.unpack(self.packed)
        world.steps = self.steps
        return world, Controller(world, np.array(self.target), self.finger_target_m, after_step)
