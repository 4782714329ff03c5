"""Every model of the library: what it is, how it fills its box, that its handles can be gripped."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from executor.assets.asset_geometry import bounds, width_at
from executor.assets.library import LIBRARY, ModelNotFound, asset_for, entry, kind, sample
from executor.assets.model import Asset, Handle, Shape
from executor.assets.parameters import AssetError, ModelEntry
from executor.sim.robot.description import robot_xml
from executor.skills.navigate import fits_between, grip_width_m, misfit
from oag.measurements import TooWide
from oag.model.symbols import Kind
from oag.sizes import GRIP_CLEARANCE_M, LEAST_SCALE, PAPER_GRIPPER, Sizing
from tests.source_tree import ROOT

SEEDS = range(5)
MODELS = sorted(LIBRARY)
KIND_OF_MOTION = {"articulated": Kind.ARTICULATED, "static": Kind.SUPPORT, "dynamic": Kind.ITEM}
# Half widths of the two open fingers across the bar, along it, and how far they reach before and behind its middle.
FINGERS_M = (PAPER_GRIPPER.opening_m / 2 + 0.015, 0.012, 0.030, 0.020)


@cache
def assets(model: str) -> list[Asset]:
    """Return five variations of a model."""
    return [asset_for(sample(model, seed)) for seed in SEEDS]


@pytest.mark.parametrize("model", MODELS)
def test_what_a_model_is_agrees_with_its_category(model: str) -> None:
    for asset in assets(model):
        assert KIND_OF_MOTION[asset.motion] is kind(entry(model))
        assert asset.category == entry(model).category
        assert asset.synset == entry(model).synset


@pytest.mark.parametrize("model", MODELS)
def test_collision_shapes_fill_the_box_of_every_variation(model: str) -> None:
    for seed in SEEDS:
        obj = sample(model, seed)
        asset = asset_for(obj)
        low, high = bounds(asset)
        half = np.array(obj.extent_m) / 2
        assert asset.extent_m == pytest.approx(obj.extent_m, abs=1e-9)
        assert high == pytest.approx(half, abs=6e-4) and low == pytest.approx(-half, abs=6e-4)


def test_variations_are_seeded_and_differ() -> None:
    for model in MODELS:
        assert sample(model, 3) == sample(model, 3)
        assert len({sample(model, seed).bbox_extent for seed in SEEDS}) >= 4


def test_every_affordance_names_what_exists() -> None:
    for model in MODELS:
        for asset in assets(model):
            links, joints = {link.name for link in asset.links}, {joint.name for joint in asset.joints}
            assert {handle.joint for handle in asset.handles} == joints
            assert {handle.link for handle in asset.handles} <= links
            assert {region.link for region in asset.regions} <= links
            assert {region.joint for region in asset.regions} - {None} <= joints
            names = [region.name for region in asset.regions]
            assert len(names) == len(set(names))
            if asset.motion != "dynamic":
                assert asset.regions


def opening_m() -> float:
    """Return how far the fingers of the simulated robot open."""
    joints = ET.fromstring(robot_xml(visual=False)).iter("joint")
    limits = [joint.find("limit") for joint in joints if "finger" in joint.attrib["name"]]
    return sum(float(limit.attrib["upper"]) for limit in limits if limit is not None)


@pytest.mark.parametrize("model", [m for m in MODELS if kind(LIBRARY[m]) is Kind.ITEM])
def test_what_is_proved_to_fit_the_gripper_fits_between_the_simulated_fingers(model: str) -> None:
    for seed in SEEDS:
        drawn = sample(model, seed)
        widest = drawn.scaled(PAPER_GRIPPER.widest_m / min(drawn.extent_m[:2]))
        factors = [Sizing(number).factor(drawn, PAPER_GRIPPER) for number in range(4)]
        for thing in (widest, *(drawn.scaled(factor) for factor in factors if LEAST_SCALE <= factor < 1.0)):
            asset = asset_for(thing)
            assert fits_between(asset, PAPER_GRIPPER)
            assert grip_width_m(asset) <= opening_m() - GRIP_CLEARANCE_M + 1e-6


def test_what_is_wider_than_the_gripper_takes_does_not_fit_between_the_fingers() -> None:
    can = sample("can", 0)
    for width_m in (0.0535, 0.057, 0.060):
        asset = asset_for(can.scaled(width_m / min(can.extent_m[:2])))
        failure = misfit("can_0", asset, PAPER_GRIPPER)
        assert not fits_between(asset, PAPER_GRIPPER) and failure is not None
        assert failure.measurements == (TooWide(width_m, pytest.approx(opening_m())),)


def _corners(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    center = np.asarray(shape.position_m)
    if shape.kind == "box":
        half = np.asarray(shape.size_m)
    else:
        lies = abs(shape.orientation[1]) > 0.1
        half = np.array([shape.size_m[0], shape.size_m[1 if lies else 0], shape.size_m[0 if lies else 1]])
    return center - half, center + half


def _is_of_the_bar(shape: Shape, handle: Handle) -> bool:
    return bool(np.linalg.norm(np.subtract(shape.position_m, handle.position_m)) < 1e-6)


@pytest.mark.parametrize("model", [m for m in MODELS if kind(LIBRARY[m]) is Kind.ARTICULATED])
def test_handles_can_be_gripped(model: str) -> None:
    for asset in assets(model):
        for handle in asset.handles:
            joint = asset.joint(handle.joint)
            upright = joint.kind == "revolute" and abs(joint.axis[2]) > 0.5
            assert handle.axis == ((0.0, 0.0, 1.0) if upright else (0.0, 1.0, 0.0))
            assert handle.thickness_m <= PAPER_GRIPPER.opening_m - 0.02
            assert handle.length_m >= 0.10
            across, along, before, behind = FINGERS_M
            reach = np.array([0.0, across, along] if upright else [0.0, along, across])
            low = np.asarray(handle.position_m) - reach - [before, 0, 0]
            high = np.asarray(handle.position_m) + reach + [behind, 0, 0]
            offsets = {j.child: np.asarray(j.position_m) for j in asset.joints}
            here = offsets[handle.link]
            for link in asset.links:
                for shape in (s for s in link.shapes if s.collides):
                    if link.name == handle.link and _is_of_the_bar(shape, handle):
                        continue
                    shift = offsets.get(link.name, np.zeros(3)) - here
                    other_low, other_high = (corner + shift for corner in _corners(shape))
                    overlap = np.minimum(high, other_high) - np.maximum(low, other_low)
                    assert not np.all(overlap > 0), f"{model}: fingers at {handle.joint} meet {link.name}"


@pytest.mark.parametrize("model", [m for m in MODELS if kind(LIBRARY[m]) is Kind.ARTICULATED])
def test_positive_motion_takes_the_handle_forward(model: str) -> None:
    from executor.assets.asset_geometry import joint_transform

    for asset in assets(model):
        for handle in asset.handles:
            joint = asset.joint(handle.joint)
            point = [*handle.position_m, 1.0]
            shut, ajar = (joint_transform(joint, joint.position(fraction)) @ point for fraction in (0.0, 0.2))
            assert ajar[0] < shut[0] - 0.03


@pytest.mark.parametrize("hinge", ["left", "right"])
def test_an_open_door_stays_in_front_of_its_own_cabinet(hinge: str) -> None:
    from executor.assets.asset_geometry import joint_transform

    obj = replace(sample("cabinet_one_door", 0), parameters={"hinge": hinge})
    asset = asset_for(obj)
    (joint,), panel = asset.joints, asset.links[1].shapes[0]
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = np.asarray(panel.position_m) + signs * np.asarray(panel.size_m)
    for angle in np.linspace(0.0, math.pi / 2, 10):
        T = joint_transform(joint, float(angle))
        assert np.all(np.abs((corners @ T[:3, :3].T + T[:3, 3])[:, 1]) <= asset.extent_m[1] / 2 + 1e-9)


def test_counts_shape_the_model() -> None:
    few, many = (asset_for(replace(sample("cabinet_drawers", 0), parameters={"drawers": count})) for count in (2, 4))
    assert [len(few.joints), len(many.joints)] == [2, 4]
    shelves = asset_for(replace(sample("shelf_open", 0), parameters={"boards": 3})).regions
    assert [region.name for region in shelves] == [
        "board_bottom",
        "board_shelf_1",
        "board_shelf_2",
        "board_shelf_3",
        "top",
    ]


def test_an_unknown_model_names_near_ones_and_the_command() -> None:
    with pytest.raises(ModelNotFound, match=r"did you mean fridge_one_door.*scene2demo assets"):
        sample("fridge_one_dor", 0)


@pytest.mark.parametrize(
    ("model", "parameters", "message"),
    [
        ("fridge_top_freezer", {"hinge": "top"}, "expected one of left, right"),
        ("cabinet_drawers", {"drawers": 9}, "expected a number from 2 to 4"),
        ("cabinet_drawers", {"drawers": 2.5}, "expected a whole number from 2 to 4"),
        ("mug", {"color": "pink"}, "expected one of white"),
        ("wardrobe_two_doors", {"handle_thickness_m": 0.2}, "expected a number from 0.014 to 0.024"),
    ],
)
def test_wrong_parameters_are_named(model: str, parameters: dict[str, object], message: str) -> None:
    with pytest.raises(AssetError, match=message):
        asset_for(replace(sample(model, 0), parameters=parameters))


def row(entry: ModelEntry) -> str:
    """Return a model's line of the table in docs/scenes.md."""
    size = f"{entry.length}, {entry.width}, {entry.height}"
    parameters = ", ".join(
        f"`{parameter}`" for parameter in entry.parameters if not str(parameter).startswith("handle_")
    )
    what = {"articulated fixture": "A, articulated", "support": "A, support", "item": "B"}[kind(entry).value]
    return f"| `{entry.model}` | `{entry.category}` | {entry.synset} | {what} | {size} | {parameters} |"


def test_the_table_of_the_page_is_up_to_date() -> None:
    page = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
    missing = [row(entry) for entry in LIBRARY.values() if row(entry) not in page]
    assert not missing, "docs/scenes.md lacks:\n" + "\n".join(missing)


@pytest.mark.parametrize(("model", "depth", "share"), [("bottle", 0.0, 1.0), ("cup", 0.8, 0.6), ("carton", 0.8, 1.0)])
def test_how_wide_a_thing_is_where_a_plane_cuts_it(model: str, depth: float, share: float) -> None:
    asset = asset_for(sample(model, 0))
    along_x = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    width_m = width_at(asset, along_x, depth * asset.extent_m[0] / 2)
    # A cup's wall has twelve flat pieces.
    assert width_m == pytest.approx(share * asset.extent_m[1], rel=0.1)
    assert width_at(asset, along_x, asset.extent_m[0]) == 0.0
