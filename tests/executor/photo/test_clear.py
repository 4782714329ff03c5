"""What is behind a glass shines through it; a can hides it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from executor.assets.library import LIBRARY
from executor.photo.fitting.evidence import PixelEvidence
from executor.photo.fitting.hypothesis import PoseHypothesis, picture_of, raycaster_of
from executor.photo.fitting.likelihood import Likelihood, Neighbourhood, SearchContext, prior_cost
from tests.executor.photo.test_fit import seen_from_above

GLASS = PoseHypothesis(LIBRARY["tumbler"], 1.2, 0.0, 0.0, 0.9, (0.06, 0.06, 0.10))
CAN = PoseHypothesis(LIBRARY["can"], 1.2, 0.0, 0.0, 0.9, (0.06, 0.06, 0.10))
CUP = PoseHypothesis(LIBRARY["cup"], 1.2, 0.0, 0.0, 0.9, (0.07, 0.07, 0.09))


def two_behind(
    true: PoseHypothesis, *, are_told_apart: bool
) -> tuple[SearchContext, tuple[float, float, float, float]]:
    """Return what is around a thing before two stripes of floor whose colours are seen through it, and its box."""
    observation, (box,) = seen_from_above(true)
    down = np.maximum(-observation.rays[..., 2], 1e-6)
    floor_m = np.where(observation.rays[..., 2] < -1e-6, observation.eye_m[2] / down, np.inf)
    stripe = (np.arange(observation.z_m.shape[0]) > (box.box_px[1] + box.box_px[3]) / 2)[:, None]
    stripe = np.broadcast_to(stripe, observation.z_m.shape)
    shown = picture_of(true, observation)[1] >= 0
    behind = np.where(stripe[..., None], (200.0, 40.0, 40.0), (40.0, 40.0, 200.0))
    rgb = np.where(shown[..., None], 0.7 * behind + 30.0, behind).astype(np.uint8)
    other = np.where(stripe & are_told_apart, 1, 0).astype(np.int32)
    around = SearchContext(
        replace(observation, rgb=rgb), floor_m, other, np.zeros(shown.shape, dtype=bool), Neighbourhood(())
    )
    return around, box.box_px


@pytest.mark.parametrize(("thing", "parts"), [(GLASS, True), (CAN, False)])
def test_faces_are_parted_by_what_is_behind_where_they_are_clear(thing: PoseHypothesis, parts: bool) -> None:
    observation, _ = seen_from_above(thing)
    rays, body = observation.rays.reshape(-1, 3), raycaster_of(thing)
    assert body is not None
    depth, plain = body.render_depth(thing, observation.eye_m, rays)
    behind = np.random.default_rng(0).integers(0, 3, len(rays)).astype(np.int32)
    _, group = body.render_depth(thing, observation.eye_m, rays, behind)
    assert ((group >= 0) == np.isfinite(depth)).all()
    kinds = {
        (face, there) if parts else face
        for face, there in zip(plain.tolist(), behind.tolist(), strict=True)
        if face >= 0
    }
    assert len(set(group[group >= 0].tolist())) == len(kinds)
    pairs = set(zip(group.tolist(), plain.tolist(), strict=True))
    assert len(pairs) == len({one for one, _ in pairs})  # None is of two faces.


def test_a_glass_is_of_the_colours_behind_it() -> None:
    costs = []
    for are_told_apart in (False, True):
        around, box_px = two_behind(GLASS, are_told_apart=are_told_apart)
        patch = PixelEvidence.around(around.observation, box_px, around.other_m, around.other, 5000)
        costs.append(Likelihood(patch, around.near).cost(GLASS))
    assert costs[1] < costs[0] - 20.0


@pytest.mark.parametrize(("height_m", "is_possible"), [(0.10, True), (0.022, True), (0.019, False), (0.5, False)])
def test_no_size_is_looked_at_that_a_scene_would_not_take(height_m: float, is_possible: bool) -> None:
    carton = PoseHypothesis(LIBRARY["carton"], 1.0, 0.0, 0.0, 0.0, (0.08, 0.05, height_m))
    assert np.isfinite(prior_cost(carton, Neighbourhood(()))) == is_possible
