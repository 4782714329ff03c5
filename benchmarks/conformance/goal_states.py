"""Random complete states of a goal's atoms: of all densities, and some in which the goal was made true."""

from __future__ import annotations

import random
from collections.abc import Iterator

from bddl.grounding import All, AtLeast, Exactly, GroundNode, Leaf, Matching, Negation, Some
from benchmarks.compiled_goals import CompiledGoal

SATISFYING = 8


def draw(goal: CompiledGoal, root: GroundNode, source: random.Random, states: int) -> Iterator[int]:
    """Yield states of all densities, then states made to satisfy the goal, upon backgrounds of several densities."""
    width = len(goal.atoms)
    for number in range(states):
        density = number / max(1, states - 1)
        yield sum(1 << index for index in range(width) if source.random() < density)
    for number in range(SATISFYING):
        best = 0
        for _ in range(20):
            values = [source.random() < number / (SATISFYING - 1) for _ in range(width)]
            make_true(root, True, values, source)
            best = goal.pack(values)
            if goal.evaluate(best):
                break
        yield best


def make_true(node: GroundNode, wanted: bool, values: list[bool], source: random.Random) -> None:
    """Set atoms so that the node gets the wanted value, choosing at random; a later choice may undo an earlier one."""
    match node:
        case Leaf(atom=atom):
            values[atom] = wanted
        case Negation(body=body):
            make_true(body, not wanted, values, source)
        case All(parts=parts) | Some(parts=parts):
            for part in parts if isinstance(node, All) is wanted else source.sample(parts, min(1, len(parts))):
                make_true(part, wanted, values, source)
        case AtLeast(count=count, parts=parts):
            for part in source.sample(parts, min(count, len(parts))):
                make_true(part, wanted, values, source)
        case Exactly(count=count, parts=parts):
            number = count if wanted else source.randint(0, len(parts))
            chosen = set(source.sample(range(len(parts)), min(number, len(parts))))
            for index, part in enumerate(parts):
                make_true(part, index in chosen, values, source)
        case Matching(count=count, cells=cells):
            width = max(map(len, cells), default=0)
            number = min(count, len(cells), width)
            rows, columns = source.sample(range(len(cells)), number), source.sample(range(width), number)
            for row, column in zip(rows, columns, strict=True):
                cell = cells[row][column]
                if cell is not None and (wanted or source.random() < 0.5):
                    make_true(cell, wanted, values, source)
