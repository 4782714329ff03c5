"""What of the physics an experiment may change: one record, beside which everything runs at its documented values.

Planning knows nothing of it: grasps, forces and speeds are chosen as ever, and what comes of them is what is asked.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from executor.assets.model import Asset
from executor.machine.extras import load_sapien
from executor.robot.description import FINGER_FRICTION, FINGER_LINKS
from executor.world.engine import TIMESTEP_S


@dataclass(frozen=True, slots=True)
class Physics:
    """Settings of a world; the defaults are what all rates are measured with.

    Attributes:
        timestep_s: Length of a step.
        finger_friction: Static and dynamic friction coefficient of the fingertips; with what they hold the engine
            takes the mean of both.
        joint_friction: Factor of what doors and drawers ask of the hand, gaskets included.
        damping: Factor of the damping of items, which stands in for rolling resistance and air.
        item_mass: Factor of the mass and inertia of items.
        item_friction: Factor of the friction coefficient of items.
        base_force, arm_force, grip_force: Factors of the force and torque limits of the drives of base (its turning
            included), arm and fingers.

    Raises:
        ValueError: A setting is not more than 0.
    """

    timestep_s: float = TIMESTEP_S
    finger_friction: float = FINGER_FRICTION
    joint_friction: float = 1.0
    damping: float = 1.0
    item_mass: float = 1.0
    item_friction: float = 1.0
    base_force: float = 1.0
    arm_force: float = 1.0
    grip_force: float = 1.0

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} has to be more than 0, got {getattr(self, name)}")

    def of(self, asset: Asset) -> Asset:
        """Returns an asset with these settings; the same one where they are the usual ones."""
        if asset.motion == "dynamic" and (self.damping, self.item_mass, self.item_friction) != (1.0,) * 3:
            links = tuple(
                replace(
                    link,
                    shapes=tuple(
                        replace(
                            s,
                            density_kg_m3=self.item_mass * s.density_kg_m3,
                            friction=self.item_friction * s.friction,
                        )
                        for s in link.shapes
                    ),
                )
                for link in asset.links
            )
            slower = {name: self.damping * getattr(asset, name) for name in ("angular_damping", "linear_damping")}
            return replace(asset, links=links, **slower)
        if asset.joints and self.joint_friction != 1.0:
            f = self.joint_friction
            joints = tuple(replace(j, friction=f * j.friction, gasket=f * j.gasket) for j in asset.joints)
            return replace(asset, joints=joints)
        return asset

    def tune(self, robot: Any) -> None:
        """Gives a robot that was loaded just now these force limits and this friction of its fingers."""
        for joint in robot.active_joints:
            kind = next((k for k in ("base", "finger") if k in joint.name), "arm")
            factor = {"base": self.base_force, "arm": self.arm_force, "finger": self.grip_force}[kind]
            if factor != 1.0:
                joint.set_drive_properties(joint.stiffness, joint.damping, factor * joint.force_limit)
        if self.finger_friction != FINGER_FRICTION:
            material = load_sapien().physx.PhysxMaterial(self.finger_friction, self.finger_friction, 0.0)
            for finger in FINGER_LINKS:
                for shape in robot.find_link_by_name(finger).collision_shapes:
                    shape.set_physical_material(material)


STANDARD = Physics()
"""The documented values."""
