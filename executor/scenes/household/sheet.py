"""Contact sheets of the rooms: one small picture each, its name and wish under it."""

from __future__ import annotations

from collections.abc import Sequence

from PIL import Image, ImageDraw

from executor.machine.vulkan import activate
from executor.pictures.overview import global_camera
from executor.pictures.render.stage import Stage, warm_up
from executor.scenes.pair import ScenePair
from executor.world.world import World

TILE_PX = (320, 240)
COLUMNS = 6
_CAPTION_PX = 30
_PAPER, _INK, _GREY = (255, 255, 255), (30, 30, 30), (110, 110, 110)


def contact_sheet(pairs: Sequence[ScenePair], *, columns: int = COLUMNS) -> Image.Image:
    """Returns a picture with a tile for each pair, seen by its global camera; needs a Vulkan renderer.

    Args:
        pairs: What to draw, row by row.
        columns: Tiles a row.
    """
    activate()
    # While this small scene lives, the rooms' scenes share its shaders; compiling them anew takes seconds a tile.
    shaders = warm_up()
    width, height = TILE_PX
    rows = -(-len(pairs) // columns)
    sheet = Image.new("RGB", (columns * width, rows * (height + _CAPTION_PX)), _PAPER)
    pen = ImageDraw.Draw(sheet)
    for index, pair in enumerate(pairs):
        left, top = index % columns * width, index // columns * (height + _CAPTION_PX)
        sheet.paste(picture(pair, TILE_PX), (left, top))
        middle = left + width / 2
        pen.text((middle, top + height + 8), pair.scene.name, fill=_INK, anchor="mm", font_size=12)
        pen.text((middle, top + height + 22), pair.query, fill=_GREY, anchor="mm", font_size=11)
    del shaders
    return sheet


def picture(pair: ScenePair, size: tuple[int, int]) -> Image.Image:
    """Returns a picture of a pair's scene at its start, width x height pixels, after `vulkan.activate`."""
    width, height = size
    with World(pair.scene, visual=True) as world:
        # Links follow the joints that were set with the first step.
        world.step()
        camera = global_camera(pair.scene, width / height)
        stage = Stage(world, [camera], {"global": size})
        return Image.fromarray(stage.show(world.pack())["global"])
