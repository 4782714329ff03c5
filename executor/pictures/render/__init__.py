"""Deferred rendering: pictures of a recorded rollout, drawn afterwards by worker processes."""

from __future__ import annotations

from executor.pictures.render.deferred import render
from executor.pictures.render.frames import Frames
from executor.pictures.render.pool import RenderFailed, RenderPool

__all__ = ["Frames", "RenderFailed", "RenderPool", "render"]
