"""Contact sheets: small pictures side by side, such as one of each asset, with words under them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from executor.assets.build import build_asset
from executor.assets.library import asset_for
from executor.assets.model import Asset
from executor.geometry import pose_vector, transform
from executor.machine.extras import load_sapien
from executor.machine.vulkan import activate
from executor.pictures.cameras import look_at
from executor.pictures.stage import warm_up
from oag import SceneObject

TILE_PX = 200
COLUMNS = 6
_LINE_PX = 14
_FOV_RAD = math.radians(28.0)
# Furniture faces -x; mugs have their ear at +x.
_AZIMUTH_RAD = {True: math.radians(215.0), False: math.radians(255.0)}
_ELEVATION_RAD = math.radians(24.0)
_OPEN_FRACTION = 0.45
_PAPER, _INK = (255, 255, 255), (30, 30, 30)
_FLOOR = (0.62, 0.61, 0.58, 1.0)


def asset_sheet(objects: Sequence[SceneObject]) -> Image.Image:
    """Returns a picture with a tile for each object, its doors half open, named after its model.

    Args:
        objects: What to draw, row by row.

    Raises:
        AssetError: When an object cannot be built.
        RendererNotFound: When nothing on this machine can draw.
    """
    activate()
    # While this small scene lives, the tiles' scenes share its shaders; compiling them anew takes seconds a tile.
    shaders = warm_up()
    sheet = contact_sheet([(_tile(asset_for(obj)), (obj.model,)) for obj in objects])
    del shaders
    return sheet


def contact_sheet(tiles: Sequence[tuple[Image.Image, Sequence[str]]], columns: int = COLUMNS) -> Image.Image:
    """Returns pictures of one size side by side, row by row, each with its lines of words under it."""
    width, height = tiles[0][0].size
    caption_px = 4 + _LINE_PX * len(tiles[0][1])
    sheet = Image.new("RGB", (columns * width, -(-len(tiles) // columns) * (height + caption_px)), _PAPER)
    pen = ImageDraw.Draw(sheet)
    for index, (picture, lines) in enumerate(tiles):
        left, top = index % columns * width, index // columns * (height + caption_px)
        sheet.paste(picture, (left, top))
        for number, words in enumerate(lines):
            middle = left + width / 2, top + height + 2 + (number + 0.5) * _LINE_PX
            pen.text(middle, words, fill=_INK, anchor="mm", font_size=11)
    return sheet


def _tile(asset: Asset) -> Image.Image:
    """One asset from its front, filling the tile."""
    sapien = load_sapien()

    scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem()])
    half = np.asarray(asset.extent_m) / 2
    material = sapien.render.RenderMaterial(base_color=list(_FLOOR), roughness=0.9, specular=0.1)
    scene.add_ground(0.0, render_material=material)
    built = build_asset(scene, "asset", asset, transform(np.eye(3), [0.0, 0.0, half[2]]), visual=True)
    if built.articulation is not None:
        built.articulation.set_qpos([joint.position(_OPEN_FRACTION) for joint in asset.joints])
        scene.set_timestep(1e-6)
        scene.step()
    radius = float(np.linalg.norm(half)) * (1.2 if built.articulation is not None else 1.0)
    _light(scene, radius)
    azimuth, level = _AZIMUTH_RAD[asset.motion != "dynamic"], math.cos(_ELEVATION_RAD)
    direction = np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(_ELEVATION_RAD)])
    distance = radius / math.sin(_FOV_RAD / 2)
    target = np.array([0.0, 0.0, half[2]])
    camera = scene.add_camera("sheet", TILE_PX, TILE_PX, _FOV_RAD, distance / 20, 20 * distance)
    vector = pose_vector(look_at(target + distance * direction, target))
    camera.set_entity_pose(sapien.Pose(vector[:3], vector[3:]))
    scene.update_render()
    camera.take_picture()
    return Image.fromarray(camera.get_picture("Color")[..., :3])


def _light(scene: Any, radius_m: float) -> None:
    scene.set_ambient_light([0.38, 0.39, 0.42])
    scene.add_directional_light(
        [0.75, 0.35, -1.0],
        [1.7, 1.65, 1.5],
        shadow=True,
        shadow_scale=3 * radius_m,
        shadow_near=-10 * radius_m,
        shadow_far=10 * radius_m,
        shadow_map_size=1024,
    )
    scene.add_directional_light([-0.2, -0.9, -0.3], [0.4, 0.44, 0.5])
