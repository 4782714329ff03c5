"""What surfaces are made of: drawn finishes for furniture, walls, floor and things, and their textures.

Textures are computed, not stored, and lie in metres on the flat faces of boxes, so that a plank is as wide on a table
as on a door. Round and bent shapes, and things that are carried, get a colour alone.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from executor.assets.library import asset_for
from executor.assets.model import Shape, Vector
from executor.assets.visuals import own_color, textured_box, textured_material
from oag import Scene, SceneObject
from oag.model.categories import Kind

Material = Literal["paint", "wood", "planks", "steel", "tiles"]
FLOOR, WALL = "floor", "wall"

_TEXTURE_PX = 256  # 5 mm a pixel: finer than a camera's at a metre.
_PLANKS, _TILES = 10, 4  # Across a texture: 12 cm, 30 cm.
_PATTERNS = 4  # Of each material; what differs beyond is colour.
_LOOK = {"paint": (0.6, 0.3), "wood": (0.5, 0.3), "planks": (0.55, 0.3), "steel": (0.35, 0.5), "tiles": (0.3, 0.45)}
_USUAL: Mapping[str, tuple[Material, ...]] = {
    FLOOR: ("planks", "tiles", "wood", "paint"),
    WALL: ("paint", "paint", "tiles", "planks"),
    "": ("paint", "wood", "planks", "steel"),
}
_WOODS = ((0.42, 0.25, 0.13), (0.55, 0.38, 0.22), (0.66, 0.52, 0.36), (0.22, 0.13, 0.08), (0.50, 0.44, 0.36))
_WORKTOP_GREY = (0.2, 0.8)
_THING_STRAYS = 0.12  # A red apple stays red.


@dataclass(frozen=True, slots=True)
class Finish:
    """What a surface is made of.

    Attributes:
        material: The kind of texture.
        color: Linear RGB of its brighter parts.
        pattern: Which of the material's patterns.
    """

    material: Material
    color: Vector
    pattern: int = 0


@dataclass(frozen=True, slots=True)
class Surfaces:
    """The finishes of a scene.

    Attributes:
        floor: Of the floor.
        finishes: Category and original colour, as `key_of` writes them -> finish; furniture of a kind matches.
    """

    floor: Finish
    finishes: Mapping[str, Finish]

    def to_json(self) -> dict[str, Any]:
        """Returns them as plain data."""
        return {"floor": asdict(self.floor), "finishes": {key: asdict(one) for key, one in self.finishes.items()}}

    def paint(self) -> Callable[[SceneObject, Shape], Any]:
        """Returns what says how a shape of a scene's object looks; it keeps textures, so make one for each world."""
        cache: dict[Finish, Any] = {}

        def drawn(thing: SceneObject, shape: Shape) -> Any:
            finish = self.finishes.get(key_of(thing.category, shape))
            if finish is None:
                return own_color(shape)
            if thing.kind is Kind.ITEM or shape.kind != "box" or finish.material == "paint":
                return (*finish.color, *shape.color[3:])
            if finish not in cache:
                cache[finish] = material_of(finish)
            return cache[finish]

        return drawn

    def slab(self, half_m: Vector) -> Any:
        """Returns the drawn shape of a floor of these half extents, at the origin."""
        return textured_box(half_m, material_of(self.floor))


def key_of(category: str, shape: Shape) -> str:
    """Returns what tells apart the surfaces that get one finish: "cabinet/0.80,0.79,0.76"."""
    return f"{category}/{','.join(f'{value:.2f}' for value in shape.color[:3])}"


def drawn_surfaces(rng: np.random.Generator, scene: Scene) -> Surfaces:
    """Returns finishes for everything in a scene; what is added to a scene changes none of the others."""
    base = int(rng.integers(2**62))

    def of(key: str) -> np.random.Generator:
        return np.random.default_rng((base, zlib.crc32(key.encode())))

    finishes: dict[str, Finish] = {}
    for thing in scene.objects.values():
        for shape in (shape for link in asset_for(thing).links for shape in link.shapes):
            key = key_of(thing.category, shape)
            # Glass stays glass.
            if not shape.visible or len(shape.color) > 3 or key in finishes:
                continue
            if thing.kind is Kind.ITEM:
                strays = 1.0 + of(key).uniform(-_THING_STRAYS, _THING_STRAYS, 3)
                finishes[key] = Finish("paint", _vector(np.clip(np.multiply(shape.color, strays), 0.0, 1.0)))
            else:
                finishes[key] = _finish(of(key), _USUAL[thing.category if thing.category in _USUAL else ""])
    return Surfaces(_finish(of(FLOOR), _USUAL[FLOOR]), finishes)


def _finish(rng: np.random.Generator, usual: tuple[Material, ...]) -> Finish:
    material = usual[int(rng.integers(len(usual)))]
    if material in ("wood", "planks"):
        color = np.multiply(_WOODS[int(rng.integers(len(_WOODS)))], rng.uniform(0.8, 1.2))
    elif material == "steel":
        color = np.full(3, rng.uniform(0.35, 0.65))
    else:
        # Mostly pale, as rooms are; sometimes of a strong colour.
        grey = np.full(3, rng.uniform(*_WORKTOP_GREY))
        color = grey + rng.uniform(0.1, 0.9) ** 2 * (rng.uniform(0.05, 0.85, 3) - grey)
    return Finish(material, _vector(np.clip(color, 0.02, 0.95)), int(rng.integers(_PATTERNS)))


def _vector(color: NDArray[Any]) -> Vector:
    r, g, b = (round(float(value), 4) for value in color)
    return (r, g, b)


def material_of(finish: Finish) -> Any:
    """Returns an engine's material with a finish's texture."""
    roughness, specular = _LOOK[finish.material]
    colors = pattern(finish.material, finish.pattern)[..., None] * np.asarray(finish.color)
    return textured_material(colors, roughness, specular)


@lru_cache(maxsize=32)
def pattern(material: Material, number: int) -> NDArray[np.float32]:
    """Returns (H, W) the brightness of a material, 0 to 1, which repeats without a seam."""
    rng = np.random.default_rng((zlib.crc32(material.encode()), number))
    rows = np.arange(_TEXTURE_PX)

    def noise(sigma: tuple[float, float]) -> NDArray[Any]:
        field = gaussian_filter(rng.standard_normal((_TEXTURE_PX, _TEXTURE_PX)), sigma, mode="wrap")
        return np.asarray(field / field.std())

    if material == "steel":
        shade = 0.93 + 0.03 * noise((0.6, 30.0)) + 0.01 * noise((0.5, 0.5))
    elif material == "wood":
        shade = 0.82 + 0.08 * np.sin(6.0 * noise((9.0, 60.0))) + 0.05 * noise((0.8, 14.0))
    elif material == "planks":
        plank = rows * _PLANKS // _TEXTURE_PX
        tone = rng.uniform(-0.12, 0.08, _PLANKS)[plank][:, None]
        gap = np.diff(plank, prepend=-1) != 0
        shade = 0.86 + tone + 0.06 * noise((0.8, 18.0)) - 0.35 * gap[:, None]
    elif material == "tiles":
        tile = rows * _TILES // _TEXTURE_PX
        tone = rng.uniform(-0.05, 0.04, (_TILES, _TILES))[tile][:, tile]
        gap = (np.diff(tile, prepend=-1) != 0) | (np.diff(tile, append=_TILES) != 0)
        shade = np.where(gap[:, None] | gap[None, :], 0.6, 0.93 + tone + 0.015 * noise((2.0, 2.0)))
    else:
        shade = 0.97 + 0.012 * noise((3.0, 3.0))
    return np.asarray(np.clip(shade, 0.0, 1.0), np.float32)
