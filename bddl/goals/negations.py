"""From ground formulas to normal form: negations are pushed down to the atoms."""

from __future__ import annotations

from collections.abc import Iterator

from bddl.goals.normal import Builder, NormalForm, Table, mapped
from bddl.semantics.ground import All, Coverage, Exactly, Ground, GroundNode, Leaf, Matching, Negation, Some

# A ground node, and whether it is to be made true or false.
_Task = tuple[GroundNode, bool]


def normal_form(ground: Ground) -> NormalForm:
    """Returns the formula with negations at its atoms only; parts that the ground formula shares stay shared.

    A state that is known in part makes the normal form true exactly when Kleene's tables make the formula true.
    """
    return _Descent().run(ground.root)


class _Descent:
    """One conversion, with a stack of its own; every task is done after the tasks that it needs."""

    def __init__(self) -> None:
        self._builder = Builder()
        # Ground nodes compare by identity here, so equal tasks are found without walking the formula.
        self._done: dict[tuple[int, bool], int] = {}

    def run(self, root: GroundNode) -> NormalForm:
        """Converts the node and everything below it."""
        stack: list[_Task] = [(root, True)]
        while stack:
            node, wanted = stack[-1]
            open_tasks = [task for task in _needs(node, wanted) if (id(task[0]), task[1]) not in self._done]
            if open_tasks:
                stack.extend(reversed(open_tasks))
                continue
            stack.pop()
            if (id(node), wanted) not in self._done:
                self._done[id(node), wanted] = self._convert(node, wanted)
        return self._builder.form(self._done[id(root), True])

    def _convert(self, node: GroundNode, wanted: bool) -> int:
        make = self._builder
        match node:
            case Leaf(atom=atom):
                return make.literal(atom, wanted)
            case Negation(body=body):
                return self._done[id(body), not wanted]
            case All(parts=parts) | Some(parts=parts):
                join = make.every if isinstance(node, All) == wanted else make.either
                return join(self._all(parts, wanted))
            case Exactly(count=count, parts=parts) if wanted:
                return make.exact(count, self._all(parts, True), self._all(parts, False))
            case Exactly(count=count, parts=parts):
                too_many = make.at_least(count + 1, self._all(parts, True))
                too_few = make.at_least(len(parts) - count + 1, self._all(parts, False))
                return make.either((too_many, too_few))
            case Matching(count=count, cells=cells):
                pair_off = make.pairing if wanted else make.no_pairing
                return pair_off(count, self._table(cells, wanted))
            case Coverage(count=count, cells=cells):
                table = self._table(cells, wanted)
                return self._coverage(count, table, wanted)

    def _coverage(self, count: int, table: Table, wanted: bool) -> int:
        make = self._builder
        outer, inner = (make.every, make.either) if wanted else (make.either, make.every)
        sides: list[int] = []
        for lines in (table, tuple(zip(*table, strict=True))):
            enough = count if wanted else len(lines) - count + 1
            sides.append(make.at_least(enough, [inner(cell for cell in line if cell is not None) for line in lines]))
        return outer(sides)

    def _all(self, parts: tuple[GroundNode, ...], wanted: bool) -> list[int]:
        return [self._done[id(part), wanted] for part in parts]

    def _table(self, cells: tuple[tuple[GroundNode | None, ...], ...], wanted: bool) -> Table:
        return mapped(cells, lambda cell: self._done[id(cell), wanted])


def _needs(node: GroundNode, wanted: bool) -> Iterator[_Task]:
    """Yields what has to be converted before a node can be."""
    match node:
        case Leaf():
            return
        case Negation(body=body):
            yield body, not wanted
        case All(parts=parts) | Some(parts=parts):
            yield from ((part, wanted) for part in parts)
        case Exactly(parts=parts):
            yield from ((part, value) for part in parts for value in (True, False))
        case Matching(cells=cells) | Coverage(cells=cells):
            yield from ((cell, wanted) for row in cells for cell in row if cell is not None)
