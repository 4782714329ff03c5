"""Finds joints that cannot be meant: hardly any range, a knob, a door that opens into the body, a follower.

Whoever opens things takes every joint for a door or a drawer. What is none is made fast; what opens into the body opens
the other way, where that is free. A note names either.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from executor.assets.imports.orient import is_panel, opening_of, outward_of
from executor.assets.imports.raw import RawAsset, RawJoint, RawLink
from executor.assets.model import LEAST_TRAVEL
from executor.geometry import Array

WIDE_RAD = np.deg2rad(60.0)
"""How far a door opens for a hand to get in beside it."""

_MIDDLE = 0.12
"""Nearer to a part's middle than this share of its span an axis goes through it."""
_OUTWARDS = 0.5  # Cosine between where a door's middle goes first and where its front faces.
_NEAR_M = 0.01
_RAYS, _INSET = 5, 0.1
_BLOCKED = 0.5  # Share of the front that something is in the way of.


def as_meant(raw: RawAsset) -> RawAsset:
    """Returns the asset with joints that can be meant as doors or drawers alone; the others are made fast.

    Args:
        raw: A shut asset at its size.
    """
    notes, joints, fast = list(raw.notes), [], []
    for joint in raw.joints:
        said, back = _unmeant(raw, joint), replace(joint, axis=-joint.axis)
        if said:
            said += "; it was made fast"
            fast.append(joint.name)
        elif (inwards := _inwards(raw, joint)) and _inwards(raw, back):
            said = f"{inwards}, and there is no other way; it was made fast"
            fast.append(joint.name)
        elif inwards:
            said = f"{inwards}: its sign was turned, so that it opens outwards"
            joint = back
        elif joint.kind == "revolute" and joint.high < WIDE_RAD:
            said = f"opens by {np.rad2deg(joint.high):.0f} degrees only"
        notes += [f"warning: joint {joint.name} {said}"] if said else []
        joints.append(joint)
    return replace(made_fast(replace(raw, joints=tuple(joints)), fast), notes=(*notes, *_top_heavy(raw)))


def _top_heavy(raw: RawAsset) -> Iterator[str]:
    """Yields which parts weigh more than the body that carries them: a slip, which the spread by volume passes over."""
    body, *others = raw.links
    for link in others:
        if body.mass_kg and link.mass_kg and link.mass_kg > body.mass_kg:
            weights = f"{link.mass_kg:g} kg, its body {body.mass_kg:g} kg"
            yield f"warning: {link.name} weighs {weights}; here their sum is spread by volume"


def made_fast(raw: RawAsset, names: Sequence[str]) -> RawAsset:
    """Returns the asset with what some joints move as parts of its body."""
    body, *others = raw.links
    welded = {joint.child for joint in raw.joints if joint.name in names}
    for link in others:
        if link.name in welded:
            masses = [mass for mass in (body.mass_kg, link.mass_kg) if mass is not None]
            mass = sum(masses) if masses else None
            body = RawLink(body.name, (*body.looks, *link.looks), (*body.bodies, *link.bodies), mass)
    links = (body, *(link for link in others if link.name not in welded))
    return replace(raw, links=links, joints=tuple(joint for joint in raw.joints if joint.name not in names))


def _unmeant(raw: RawAsset, joint: RawJoint) -> str:
    """Returns why a joint is that of no door and no drawer, as what goes on after its name; empty where it may be."""
    if joint.mimics:
        return f"follows {joint.mimics} (mimic), and here nothing moves by itself"
    if joint.kind == "revolute" and _turns_about_its_middle(raw.link_of(joint), joint):
        return f"turns {joint.child} about its own middle: a knob, no door"
    if joint.high < LEAST_TRAVEL[joint.kind]:
        return f"moves by {_travel(joint)} only"
    if joint.kind == "revolute" and is_panel(raw.link_of(joint)) and abs(_opening(raw, joint)) < _OUTWARDS:
        return f"turns {joint.child} in its own plane, which opens nothing; its axis may be wrong"
    return ""


def _inwards(raw: RawAsset, joint: RawJoint) -> str:
    """Returns that a joint moves a door or a drawer into the body; empty where it does not."""
    if joint.kind == "prismatic":
        return _obstructed(raw, joint)
    inwards = is_panel(raw.link_of(joint)) and _opening(raw, joint) < -_OUTWARDS
    return f"swings {joint.child} into the body" if inwards else ""


def _opening(raw: RawAsset, joint: RawJoint) -> float:
    """Returns the cosine between where the middle of a door goes first and where its front faces."""
    return float(opening_of(raw, joint) @ outward_of(raw, joint))


def _travel(joint: RawJoint) -> str:
    return f"{np.rad2deg(joint.high):.1f} degrees" if joint.kind == "revolute" else f"{1000 * joint.high:.0f} mm"


def _turns_about_its_middle(link: RawLink, joint: RawJoint) -> bool:
    points = np.concatenate([part.vertices_m for part in link.without_handles])
    low, high = points.min(axis=0), points.max(axis=0)
    lever = (low + high) / 2 - joint.origin_m
    across = lever - float(lever @ joint.axis) * joint.axis
    spread = points - np.outer(points @ joint.axis, joint.axis)
    span_m = float(np.linalg.norm(np.ptp(spread, axis=0)))
    return float(np.linalg.norm(across)) < _MIDDLE * span_m


def _obstructed(raw: RawAsset, joint: RawJoint) -> str:
    """Returns that a drawer slides into the body: most of its leading face has the body in its way."""
    points, axis = raw.link_of(joint).points_m, joint.axis
    side, up = np.linalg.svd(axis[None])[2][1:]
    reach = points @ np.stack([side, up, axis], axis=1)
    low, high = reach.min(axis=0), reach.max(axis=0)
    shares = np.linspace(_INSET, 1.0 - _INSET, _RAYS)
    starts = [
        (low[0] + a * (high[0] - low[0])) * side + (low[1] + b * (high[1] - low[1])) * up + high[2] * axis
        for a in shares
        for b in shares
    ]
    triangles = np.concatenate([part.vertices_m[part.faces] for part in raw.links[0].bodies])
    ways_m = np.array([_free_way_m(triangles, start, axis) for start in starts])
    met = ways_m < joint.high - _NEAR_M
    if float(met.mean()) < _BLOCKED:
        return ""
    after = f"after {1000 * max(0.0, float(np.median(ways_m[met]))):.0f} of {1000 * joint.high:.0f} mm"
    return f"slides {joint.child} into the body {after}"


def _free_way_m(triangles: Array, start: Array, axis: Array) -> float:
    """Returns how far a ray goes before it meets one of the triangles (N, 3, 3).

    Source: Moeller and Trumbore, Fast, minimum storage ray-triangle intersection (1997).
    """
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    across = np.cross(axis, ac)
    scale = np.einsum("ij,ij->i", ab, across)
    hit = np.abs(scale) > 1e-12
    a, ab, ac, across, scale = a[hit], ab[hit], ac[hit], across[hit], scale[hit]
    off = start - a
    u = np.einsum("ij,ij->i", off, across) / scale
    turned = np.cross(off, ab)
    v = turned @ axis / scale
    way_m = np.einsum("ij,ij->i", ac, turned) / scale
    met = way_m[(u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (way_m > -1e-4)]
    return float(met.min(initial=np.inf))
