"""Whether a thing fits between the fingers, decided before anything moves."""

from __future__ import annotations

from executor.assets.model import Asset
from executor.records.rollout import Failure, FailureKind
from oag.revision.measurements import TooWide
from oag.task.sizes import GRIPPER_OPENING_M, WIDEST_GRASP_M

_ROUNDING_M = 1e-6


def grip_width_m(asset: Asset) -> float:
    """Returns how far apart the fingers are when they hold a thing: the bar of its handle, or its own width."""
    if asset.handles:
        return asset.handles[0].thickness_m
    return asset.graspable_width_m if asset.graspable_width_m is not None else min(asset.extent_m[:2])


def fits_between(asset: Asset) -> bool:
    """Decides whether the fingers can close around all of a thing."""
    return grip_width_m(asset) <= WIDEST_GRASP_M + _ROUNDING_M


def misfit(target: str, asset: Asset) -> Failure | None:
    """Returns a failure when a thing is too wide for the gripper and has no rim to be held by, else None."""
    if fits_between(asset) or asset.rim is not None:
        return None
    width_m = grip_width_m(asset)
    takes = f"the gripper opens to {GRIPPER_OPENING_M * 1000:.0f} mm and takes at most {WIDEST_GRASP_M * 1000:.0f}"
    message = f"{target} is {width_m * 1000:.0f} mm wide, {takes}"
    return Failure(FailureKind.TOO_WIDE, message, (TooWide(round(width_m, 4), GRIPPER_OPENING_M),))
