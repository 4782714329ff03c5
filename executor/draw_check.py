"""Draws one small picture with SAPIEN; run as a program, since a broken driver can end the process it is in.

Exit status 0 means that the picture shows the box in front of the camera. Anything else went wrong, and
standard error says what. Usage: `python -m executor.draw_check`.
"""

from __future__ import annotations

import sys

from executor import vulkan

_SIZE_PX = 64
_VISIBLE_STEP = 0.05


def centre_contrast() -> float:
    """Returns how much brighter the picture's centre is than its corner: 0 when nothing was drawn.

    The scene is a white box under white light before a black background.
    """
    import sapien

    scene = sapien.Scene()
    scene.set_ambient_light([0.5, 0.5, 0.5])
    scene.add_directional_light([1, 0, -1], [1, 1, 1])
    builder = scene.create_actor_builder()
    builder.add_box_visual(half_size=[0.2, 0.2, 0.2], material=[1.0, 1.0, 1.0])
    builder.initial_pose = sapien.Pose([1.0, 0.0, 0.0])
    builder.build_kinematic(name="box")
    camera = scene.add_camera("check", _SIZE_PX, _SIZE_PX, fovy=1.0, near=0.01, far=10.0)
    scene.step()
    scene.update_render()
    camera.take_picture()
    picture = camera.get_picture("Color")[..., :3]
    middle = _SIZE_PX // 2
    return float(picture[middle, middle].mean() - picture[0, 0].mean())


def main() -> int:
    """Returns 0 when the box is seen."""
    vulkan.activate()
    contrast = centre_contrast()
    if contrast > _VISIBLE_STEP:
        return 0
    sys.stderr.write(f"the box is not to be seen (contrast {contrast:.3f})\n")
    return 1


if __name__ == "__main__":
    sys.exit(main())
