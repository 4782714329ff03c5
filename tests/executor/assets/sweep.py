"""Every link of an asset as a body of its own, so that the engine tells how deep links overlap at any joint position.

Inside an articulation the engine leaves out the contacts between a link and its parent.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from executor.assets.asset_geometry import joint_transform
from executor.assets.build import build_asset
from executor.assets.model import Asset
from executor.geometry import Array, pose_vector
from executor.sim.engine import ORACLE_TIMESTEP_S
from executor.system.extras import load_sapien


class Sweep:
    """Overlaps between the links of one asset, and between its moving links and a floor at z = `floor_m`."""

    def __init__(self, asset: Asset, floor_m: float | None = None) -> None:
        sapien = load_sapien()
        self.asset, self._pose = asset, sapien.Pose
        self.scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
        self.scene.set_timestep(ORACLE_TIMESTEP_S)
        if floor_m is not None:
            self.scene.add_ground(floor_m, render=False)
        self.bodies = {}
        for link in asset.links:
            alone = Asset(asset.category, "dynamic", (link,), asset.extent_m)
            built = build_asset(self.scene, link.name, alone, np.eye(4), visual=False, gravity=False)
            self.bodies[link.name] = built.bodies[link.name]

    def deepest(self, positions: Mapping[str, float]) -> tuple[float, str]:
        """Return the smallest separation [m] between two bodies, and which, at joint positions (shut where absent)."""
        poses: dict[str, Array] = {self.asset.links[0].name: np.eye(4)}
        for joint in self.asset.joints:
            poses[joint.child] = joint_transform(joint, positions.get(joint.name, joint.limits[0]))
        for name, body in self.bodies.items():
            vector = pose_vector(poses.get(name, np.eye(4)))
            body.entity.set_pose(self._pose(vector[:3], vector[3:]))
            body.set_linear_velocity([0.0] * 3)
            body.set_angular_velocity([0.0] * 3)
        self.scene.step()
        least, names = 1.0, ""
        for contact in self.scene.physx_system.get_contacts():
            pair = sorted(body.entity.name for body in contact.bodies)
            if pair == sorted((self.asset.links[0].name, "ground")):
                continue
            for point in contact.points:
                if point.separation < least:
                    least, names = float(point.separation), " x ".join(pair)
        return least, names
