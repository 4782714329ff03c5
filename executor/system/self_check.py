"""Try the simulator in earnest; run as a program, since a broken library can end its process.

Usage: `python -m executor.system.self_check physics` lets a box fall to the ground; `... drawing` draws one and looks
for it in the picture. Exit status 0 means that it worked. Otherwise the last line of standard error has the reason.
"""

from __future__ import annotations

import subprocess
import sys
from typing import Any, Literal

from executor.system import vulkan
from executor.system.extras import load_sapien

Check = Literal["physics", "drawing"]

_TIMEOUT_S = 300.0
_BOX_HALF_M = 0.2
_DROP_M = 0.1
_REST_TOLERANCE_M = 0.01
_STEPS = 250
_SIZE_PX = 64
_VISIBLE_STEP = 0.05


def problem_with(check: Check) -> str:
    """Return why a check fails in a process of its own; "" when it works."""
    command = [sys.executable, "-m", "executor.system.self_check", check]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        return f"it took longer than {_TIMEOUT_S:.0f} s"
    if done.returncode == 0:
        return ""
    return (done.stderr.strip().splitlines() or [f"the process died (exit status {done.returncode})"])[-1]


def _resting_height_m(sapien: Any) -> float:
    """Return the height of a box's centre above the ground after it fell for a second."""
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    scene.add_ground(0.0, render=False)
    builder = scene.create_actor_builder()
    builder.add_box_collision(half_size=[_BOX_HALF_M] * 3)
    builder.initial_pose = sapien.Pose([0.0, 0.0, _BOX_HALF_M + _DROP_M])
    box = builder.build(name="box")
    scene.set_timestep(1.0 / _STEPS)
    for _ in range(_STEPS):
        scene.step()
    return float(box.pose.p[2])


def _centre_contrast(sapien: Any) -> float:
    """Return how much brighter the picture's centre, where a lit box stands, is than its corner."""
    scene = sapien.Scene()
    scene.set_ambient_light([0.5, 0.5, 0.5])
    scene.add_directional_light([1, 0, -1], [1, 1, 1])
    builder = scene.create_actor_builder()
    builder.add_box_visual(half_size=[_BOX_HALF_M] * 3, material=[1.0, 1.0, 1.0])
    builder.initial_pose = sapien.Pose([1.0, 0.0, 0.0])
    builder.build_kinematic(name="box")
    camera = scene.add_camera("check", _SIZE_PX, _SIZE_PX, fovy=1.0, near=0.01, far=10.0)
    scene.step()
    scene.update_render()
    camera.take_picture()
    picture = camera.get_picture("Color")[..., :3]
    middle = _SIZE_PX // 2
    return float(picture[middle, middle].mean() - picture[0, 0].mean())


def main(arguments: list[str]) -> int:
    """Return 0 when the named check works, 1 when it gives a wrong result, 2 when there is no such check."""
    if arguments == ["physics"]:
        sapien = load_sapien()

        height_m = _resting_height_m(sapien)
        if abs(height_m - _BOX_HALF_M) < _REST_TOLERANCE_M:
            return 0
        sys.stderr.write(f"a box that fell rests at {height_m:.3f} m instead of {_BOX_HALF_M} m\n")
        return 1
    if arguments == ["drawing"]:
        vulkan.activate()
        sapien = load_sapien()

        contrast = _centre_contrast(sapien)
        if contrast > _VISIBLE_STEP:
            return 0
        sys.stderr.write(f"the box is not to be seen in the picture (contrast {contrast:.3f})\n")
        return 1
    sys.stderr.write('name one check: "physics" or "drawing"\n')
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
