"""A subtask's exact start: everything that the physics and the executor need to go on from there.

At every subtask boundary the world is settled, packed, built again and unpacked, and the run goes on from that.
So a retry or a replay from a checkpoint equals, to the last bit, the run that made it: contact caches cannot be packed,
and are empty in both.
"""

from __future__ import annotations

import base64
import json
from dataclasses import asdict, dataclass

import numpy as np

from bddl.errors import Scene2DemoError
from executor.assets.asset_geometry import rolls_freely
from executor.geometry import transform_from_quaternion
from executor.sim.belief import weaken_grip
from executor.sim.engine import STANDARD, Physics
from executor.sim.faults import Fault
from executor.sim.world import World
from executor.skills.control import DISPLACED_M, LOOK_EVERY_S, TIPPED_DEG, Controller, Tick, settle_to_rest
from executor.skills.session import Hand
from executor.skills.trajectories import NoiseStream
from oag import Scene, SceneError


class CheckpointError(Scene2DemoError, ValueError):
    """The bytes are no checkpoint of this version."""


class StartUnstable(SceneError):
    """Something falls, slides or tips before the robot moves: what follows is no episode of the scene."""


VERSION = 2
START_SETTLE_S = 0.5  # Things come to rest on their supports.


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A subtask's start.

    Attributes:
        packed: The physics engine's state.
        target: (Q,) joint targets.
        finger_target_m: Target of each finger.
        steps: Physics steps since the rollout began.
        held: Id of the item in the gripper, or None.
        gripped: Id of the fixture whose handle is in the gripper, or None.
        lifted_from: Contacts that the held item had where it was taken, as pairs of bodies.
        released: Pairs of bodies that the fingers may touch while they leave, from the subtask before.
        state_hash: Hash of everything recorded up to here.
        cargo: Ids of the held item's cargo.
        upward: Direction in the hand's frame that pointed up when the item was taken; None without cargo.
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
    cargo: tuple[str, ...] = ()
    upward: tuple[float, ...] | None = None

    @property
    def hand(self) -> Hand:
        """What is in the gripper."""
        contacts = frozenset(self.lifted_from), frozenset(self.released)
        return Hand(self.held, self.gripped, *contacts, self.cargo, self.upward)

    @classmethod
    def of(cls, world: World, control: Controller, hand: Hand | None = None, state_hash: str = "") -> Checkpoint:
        """Return the present state of a world, with what is in the hand and the hash of the recording."""
        hand = hand or Hand()
        return cls(
            packed=world.pack(),
            target=tuple(float(v) for v in control.target),
            finger_target_m=control.finger_target_m,
            steps=world.steps,
            held=hand.held,
            gripped=hand.gripped,
            lifted_from=tuple(sorted(hand.lifted_from)),
            released=tuple(sorted(hand.released)),
            state_hash=state_hash,
            cargo=hand.cargo,
            upward=hand.upward,
        )

    @classmethod
    def at_start(cls, scene: Scene, faults: tuple[Fault, ...] = (), physics: Physics = STANDARD) -> Checkpoint:
        """Return the start of an episode: the scene as built, once it has come to rest.

        Raises:
            StartUnstable: Something does not stay where the scene has it, unless faults are the reason.
        """
        pose = scene.robot
        with World(scene, physics=physics) as world:
            weaken_grip(world, faults)
            start = np.array(pose.model.start(pose.position[0], pose.position[1], pose.yaw_rad))
            control = Controller(world, start, float(world.robot.get_qlimits()[-1, 1]), lambda: None)
            control.settle(START_SETTLE_S)
            begins = cls.of(world, control)
            if not faults:
                # The checkpoint is packed: what happens from here on decides, and leaves no trace in the states.
                settle_to_rest(control, LOOK_EVERY_S)
                _require_unmoved(scene, world)
            return begins

    def to_bytes(self) -> bytes:
        """Return the checkpoint as UTF-8 JSON."""
        fields = asdict(self) | {"packed": base64.b64encode(self.packed).decode(), "version": VERSION}
        return json.dumps(fields).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> Checkpoint:
        """Return the checkpoint in bytes written by `to_bytes`.

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
            fields["cargo"] = tuple(fields.get("cargo", ()))
            fields["upward"] = None if fields.get("upward") is None else tuple(map(float, fields["upward"]))
            found = cls(**fields)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise CheckpointError(f"not a checkpoint: {error}") from error
        if version != VERSION:
            raise CheckpointError(f"checkpoint version {version}, this program reads {VERSION}")
        return found

    def restore(
        self,
        scene: Scene,
        after_step: Tick,
        faults: tuple[Fault, ...] = (),
        physics: Physics = STANDARD,
        noise: NoiseStream | None = None,
    ) -> tuple[World, Controller]:
        """Return a fresh world in this state, and a controller that holds it there."""
        world = World(scene, physics=physics)
        weaken_grip(world, faults)
        world.unpack(self.packed)
        world.steps = self.steps
        return world, Controller(world, np.array(self.target), self.finger_target_m, after_step, noise)


def _require_unmoved(scene: Scene, world: World) -> None:
    """Check that every item at rest is where, and as upright as, the scene has it.

    Raises:
        StartUnstable: The message names each item that is not, and how far it moved or tipped.
    """
    moved = []
    for name in world.dynamic_ids:
        obj, now = scene.objects[name], world.T_world_link(name)
        before = transform_from_quaternion(obj.position, obj.orientation)
        distance_m = float(np.linalg.norm(now[:3, 3] - before[:3, 3]))
        cosine = float(np.clip(now[:3, 2] @ before[:3, 2], -1.0, 1.0))
        tipped_deg = 0.0 if rolls_freely(world.assets[name]) else float(np.degrees(np.arccos(cosine)))
        if distance_m > DISPLACED_M or tipped_deg > TIPPED_DEG:
            moved.append(f"{name} moves by {100 * distance_m:.0f} cm and tips by {tipped_deg:.0f} degrees")
    if moved:
        hint = "`scene2demo scenes FILE --check` tells what positions say of it"
        problem = f"does not stay as it is before the robot moves: {'; '.join(moved)}"
        raise StartUnstable(problem, source=scene.name, hint=hint)
