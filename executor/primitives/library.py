"""The 21 primitives and what runs them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from executor.motion.planning.moves import MOVES
from executor.primitives.articulate import articulate
from executor.primitives.driving import retreat
from executor.primitives.grasp import approach, converge, grasp, ungrasp
from executor.primitives.move import move
from executor.primitives.navigate import navigate_to_support, navigate_to_target
from executor.primitives.session import Session, StepResult
from oag import Action, Primitive

Runner = Callable[[Session, Action], StepResult]

LIBRARY: Mapping[Primitive, Runner] = MappingProxyType(
    {
        Primitive.APPROACH: approach,
        Primitive.CONVERGE: converge,
        Primitive.GRASP: grasp,
        Primitive.ARTICULATE_OPEN: articulate,
        Primitive.ARTICULATE_CLOSE: articulate,
        Primitive.UNGRASP: ungrasp,
        Primitive.RETREAT: retreat,
        Primitive.NAVIGATE_TO_TARGET: navigate_to_target,
        Primitive.NAVIGATE_TO_SUPPORT: navigate_to_support,
        **{primitive: move for primitive in MOVES},
    }
)
"""Every primitive of the library with the function that runs it."""
