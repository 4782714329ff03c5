"""A goal taken apart: literals that every way to make it true has, and groups of conjuncts that share no atom.

What holds of each group alone holds of the goal: costs add up, and ways to make the groups true combine freely.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from bddl.goals.normal import (
    AtLeast,
    Builder,
    Every,
    Exact,
    Lit,
    NoPairing,
    NormalForm,
    NormalNode,
    Pairing,
    Table,
    bits,
)
from bddl.goals.substitution import Nodes, assuming


class Cluster(NamedTuple):
    """Conjuncts that share atoms, or one that shares none.

    Attributes:
        form: The conjunction of them.
        entangled: Whether parts that may have to be made true together share an atom, so that their costs do not
            simply add up.
    """

    form: NormalForm
    entangled: bool


class Clusters(NamedTuple):
    """A goal as a conjunction.

    Attributes:
        true: Atoms that have to be true, as a set of bits.
        false: Atoms that have to be false.
        groups: What else has to be made true; no two groups share an atom.
        contradictory: Whether it is plain already that nothing makes the goal true. The groups are then those of the
            goal as it was given, and may share atoms with the literals.
    """

    true: int
    false: int
    groups: tuple[Cluster, ...]
    contradictory: bool


def clusters(form: NormalForm) -> Clusters:
    """Takes a formula apart.

    The literals that it requires are put into its other conjuncts, which become simpler and may turn out to require
    literals themselves. A state makes the result true exactly when it makes the formula true, also by Kleene's tables
    when it is known in part: where a required literal is not true, neither is the whole.
    """
    builder = Builder(form)
    required = _Required()
    others: list[int] = []
    fresh = [form.root]
    while fresh:
        others += required.literals_among(builder, _conjuncts(builder.nodes, fresh))
        if required.true & required.false or builder.false in others:
            return _as_given(form)
        affected = [part for part in others if builder.atoms[part] & (required.true | required.false)]
        others = [part for part in others if not builder.atoms[part] & (required.true | required.false)]
        fresh = assuming(builder, builder, affected, required.true, required.false)
    return Clusters(required.true, required.false, _groups(builder, dict.fromkeys(others)), contradictory=False)


class _Required:
    """Atoms that have to be true, and atoms that have to be false, as sets of bits."""

    __slots__ = ("false", "true")

    def __init__(self) -> None:
        self.true = 0
        self.false = 0

    def literals_among(self, nodes: Nodes, parts: Iterable[int]) -> list[int]:
        """Takes the literals among some conjuncts, and returns the other conjuncts."""
        others: list[int] = []
        for part in parts:
            node = nodes.nodes[part]
            if not isinstance(node, Lit):
                others.append(part)
            elif node.value:
                self.true |= 1 << node.atom
            else:
                self.false |= 1 << node.atom
        return others


def _as_given(form: NormalForm) -> Clusters:
    required = _Required()
    others = required.literals_among(form, _conjuncts(form.nodes, [form.root]))
    return Clusters(required.true, required.false, _groups(form, others), contradictory=True)


def _conjuncts(nodes: Sequence[NormalNode], roots: Iterable[int]) -> list[int]:
    """Returns the conjuncts of some nodes, nested conjunctions opened, each once."""
    found: dict[int, None] = {}
    pending = [*roots][::-1]
    while pending:
        part = pending.pop()
        node = nodes[part]
        if isinstance(node, Every):
            pending.extend(reversed(node.parts))
        else:
            found[part] = None
    return list(found)


def _groups(nodes: Nodes, conjuncts: Iterable[int]) -> tuple[Cluster, ...]:
    """Returns the conjuncts, grouped so that no two groups share an atom, in the order of their first ones."""
    parts = tuple(conjuncts)
    leader = list(range(len(parts)))
    owner: dict[int, int] = {}
    for index, part in enumerate(parts):
        for atom in bits(nodes.atoms[part]):
            ours, theirs = _first(leader, index), _first(leader, owner.setdefault(atom, index))
            leader[max(ours, theirs)] = min(ours, theirs)
    grouped: dict[int, list[int]] = {}
    for index, part in enumerate(parts):
        grouped.setdefault(_first(leader, index), []).append(part)
    return tuple(_cluster(nodes, members) for members in grouped.values())


def _first(leader: list[int], index: int) -> int:
    """Returns the leader of an index's group, and shortens the way to it (union-find with path halving)."""
    while leader[index] != index:
        leader[index] = leader[leader[index]]
        index = leader[index]
    return index


def _cluster(nodes: Nodes, parts: list[int]) -> Cluster:
    builder = Builder()
    own = builder.form(builder.every(assuming(nodes, builder, parts, 0, 0)))
    return Cluster(own, any(entangled(own, node) for node in own.nodes))


def entangled(form: NormalForm, node: NormalNode) -> bool:
    """Whether parts of a node that may be needed together share an atom."""
    match node:
        case Every(parts=parts) | AtLeast(parts=parts) | Exact(wanted=parts):
            return _overlap(form.atoms[part] for part in parts)
        case Pairing(cells=cells):
            # Cells that share an atom do no harm where they are all in one row, or all in one column.
            columns = tuple(zip(*cells, strict=True))
            return _overlap(_line_atoms(form, cells)) and _overlap(_line_atoms(form, columns))
        case NoPairing():
            # How many cells have to be made false is more than a matter of adding up, shared atoms or not.
            return True
    return False


def _line_atoms(form: NormalForm, lines: Table) -> Iterator[int]:
    for line in lines:
        atoms = 0
        for cell in line:
            atoms |= 0 if cell is None else form.atoms[cell]
        yield atoms


def _overlap(masks: Iterator[int]) -> bool:
    seen = 0
    for mask in masks:
        if seen & mask:
            return True
        seen |= mask
    return False
