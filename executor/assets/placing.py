"""An asset moved in its own frame or grown about its origin."""

from __future__ import annotations

import math
from dataclasses import replace

from executor.assets.model import Asset, Handle, Joint, Link, Quaternion, Region, Rim, Shape, Vector

_SQUARE_M = 1e-3


def shifted(asset: Asset, by_m: Vector) -> Asset:
    """Returns the asset with everything moved in the root frame; its extent is not changed."""
    root = asset.links[0].name

    def moved(position: Vector) -> Vector:
        x, y, z = (value + offset for value, offset in zip(position, by_m, strict=True))
        return (x, y, z)

    body = tuple(replace(shape, position_m=moved(shape.position_m)) for shape in asset.links[0].shapes)
    return replace(
        asset,
        links=(replace(asset.links[0], shapes=body), *asset.links[1:]),
        joints=tuple(replace(joint, position_m=moved(joint.position_m)) for joint in asset.joints),
        regions=tuple(
            replace(region, center_m=moved(region.center_m)) if region.link == root else region
            for region in asset.regions
        ),
        rim=None if asset.rim is None else replace(asset.rim, center_m=moved(asset.rim.center_m)),
    )


def scaled(asset: Asset, factor: float) -> Asset:
    """Returns the asset at another size: every length times the factor, densities and angles as they were.

    Mass so goes with the cube of the factor and inertia with its fifth power, and what a container holds with its
    cube.
    """

    def longer(vector: Vector) -> Vector:
        return (factor * vector[0], factor * vector[1], factor * vector[2])

    def shape(part: Shape) -> Shape:
        return replace(
            part,
            size_m=tuple(factor * value for value in part.size_m),
            position_m=longer(part.position_m),
            vertices_m=tuple(longer(vertex) for vertex in part.vertices_m),
        )

    def joint(part: Joint) -> Joint:
        low, high = part.limits
        slides = part.kind == "prismatic"
        limits = (factor * low, factor * high) if slides else part.limits
        return replace(part, position_m=longer(part.position_m), limits=limits)

    def handle(part: Handle) -> Handle:
        return replace(
            part,
            position_m=longer(part.position_m),
            length_m=factor * part.length_m,
            thickness_m=factor * part.thickness_m,
        )

    def region(part: Region) -> Region:
        return replace(part, center_m=longer(part.center_m), half_extents_m=longer(part.half_extents_m))

    def rim(part: Rim) -> Rim:
        return replace(
            part,
            center_m=longer(part.center_m),
            radius_m=factor * part.radius_m,
            thickness_m=factor * part.thickness_m,
            depth_m=factor * part.depth_m,
        )

    width = asset.graspable_width_m
    return replace(
        asset,
        links=tuple(Link(link.name, tuple(shape(part) for part in link.shapes)) for link in asset.links),
        extent_m=longer(asset.extent_m),
        joints=tuple(joint(part) for part in asset.joints),
        handles=tuple(handle(part) for part in asset.handles),
        regions=tuple(region(part) for part in asset.regions),
        graspable_width_m=None if width is None else factor * width,
        grasp_point_m=longer(asset.grasp_point_m),
        rim=None if asset.rim is None else rim(asset.rim),
    )


def yaw_then_pitch(about_z_rad: float, then_about_y_rad: float) -> Quaternion:
    """Returns the quaternion w x y z of a turn about z followed by one about the new y."""
    cz, sz = math.cos(about_z_rad / 2), math.sin(about_z_rad / 2)
    cy, sy = math.cos(then_about_y_rad / 2), math.sin(then_about_y_rad / 2)
    return (cz * cy, -sz * sy, cz * sy, sz * cy)


def shorter_sides(extent_m: Vector) -> tuple[Vector, ...]:
    """Returns the horizontal axes that fingers close along on a box: across its shorter side, or both of a square."""
    along_x, along_y, _ = extent_m
    axes: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    if abs(along_x - along_y) < _SQUARE_M:
        return axes
    return axes[:1] if along_x < along_y else axes[1:]
