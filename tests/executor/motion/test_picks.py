"""From where an item is taken when most of the floor around it is not to be had."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import oag
from executor.assets.library import sample
from executor.geometry import wrap_angle
from executor.motion.oracle import CollisionOracle
from executor.motion.planner import Planner
from executor.motion.reach import TURNS_RAD, pick_stances
from executor.world import World
from oag import Action, Primitive, Scene, SceneObject
from tests.executor.helpers import block
