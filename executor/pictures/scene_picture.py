"""One picture of a scene as it starts: nothing is planned, and no physics runs."""

from __future__ import annotations

from PIL import Image

from executor.machine.vulkan import activate
from executor.pictures.overview import cameras_for
from executor.pictures.stage import Stage, warm_up
from executor.world.world import World
from oag import Scene

SIZE_PX = (960, 720)
_VIEW = "global"


def scene_picture(scene: Scene, size_px: tuple[int, int] = SIZE_PX) -> Image.Image:
    """Returns the overview of a scene: every object and the robot, from the side that shows the most.

    Args:
        scene: What to draw; its things stand where it says, also in mid-air.
        size_px: Width and height.

    Raises:
        AssetError: An object cannot be built.
        RendererNotFound: Nothing on this machine can draw.
    """
    activate()
    shaders = warm_up()  # While this small scene lives, the other one shares its shaders.
    cameras = cameras_for(scene, (_VIEW,), aspect=size_px[0] / size_px[1])
    with World(scene, visual=True) as world:
        stage = Stage(world, cameras, {_VIEW: size_px})
        picture = Image.fromarray(stage.show(world.pack())[_VIEW])
        del stage
    del shaders
    return picture
