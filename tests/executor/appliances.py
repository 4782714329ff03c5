"""Drawn scenes with one appliance that has a button or a knob."""

from __future__ import annotations

from typing import Any

import numpy as np

from executor.scenes.file import complete_scene
from oag import Scene

KINDS = ("microwave", "oven", "lamp")
CONTROLS = ("button", "knob")


def appliance(
    kind: str, control: str, seed: int, *, switched: str = "off", robot: str = "panda-lift", **others: dict[str, Any]
) -> Scene:
    """Return a scene with a microwave on a counter, an oven, or a lamp on a table, at a drawn place and height.

    Args:
        others: Further objects, in the frame of the appliance's furniture: it stands at 1.3 m from the origin.
    """
    rng = np.random.default_rng([seed, *kind.encode(), *control.encode()])
    heading_deg = float(rng.uniform(-180.0, 180.0))
    c, s = np.cos(np.deg2rad(heading_deg)), np.sin(np.deg2rad(heading_deg))

    def placed(x: float, y: float) -> list[float]:
        return [round(float(x * c - y * s), 3), round(float(x * s + y * c), 3)]

    there = {"position": placed(1.3, 0.0), "heading_deg": heading_deg}
    own = {"category": kind, "parameters": {"control": control, "switched": switched}}
    at = [round(float(rng.uniform(-0.14, -0.05)), 3), round(float(rng.uniform(-0.2, 0.2)), 3)]
    objects: dict[str, dict[str, Any]] = {}
    if kind == "oven":
        objects["oven_0"] = {**own, **there, "bbox_extent": [0.65, 0.58, round(float(rng.uniform(0.78, 0.92)), 3)]}
    elif kind == "microwave":
        high = [0.6, 1.0, round(float(rng.uniform(0.60, 0.95)), 3)]
        objects["counter_0"] = {"category": "countertop", "model": "counter_plain", **there, "bbox_extent": high}
        objects["microwave_0"] = {**own, "on": "counter_0", "at": [0.0, at[1]]}
    else:
        high = [0.6, 0.9, round(float(rng.uniform(0.50, 0.90)), 3)]
        objects["table_0"] = {"category": "table", **there, "bbox_extent": high}
        objects["lamp_0"] = {**own, "on": "table_0", "at": at, "fixed": True}
    for name, thing in others.items():
        thing = {**thing, "heading_deg": heading_deg}
        objects[name] = {**thing, "position": placed(*thing["position"])} if "position" in thing else thing
    start = placed(float(rng.uniform(-0.8, 0.2)), float(rng.uniform(-0.8, 0.8)))
    pose = {"position": start, "heading_deg": round(float(rng.uniform(-180.0, 180.0)), 1), "name": robot}
    found = complete_scene({"name": f"{kind}_{control}_{seed}", "robot": pose, "objects": objects})
    assert found.scene is not None, found.problems
    return found.scene
