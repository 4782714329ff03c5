"""Values put in for atoms of a normal form."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TypeAlias

from bddl.goals.normal import Builder, Lit, NormalForm, NormalNode, inside

# Both hold nodes and the atoms below each.
Nodes: TypeAlias = NormalForm | Builder


def assuming(nodes: Nodes, builder: Builder, parts: Iterable[int], true: int, false: int) -> list[int]:
    """Returns what some nodes become, simplified, when some atoms have values.

    Args:
        nodes: Where the nodes are.
        builder: Where the results are made; it may be the same.
        parts: The positions of the nodes.
        true: Atoms that are true, as a set of bits.
        false: Atoms that are false.

    Returns:
        The positions of the results in the builder, in the same order.
    """
    roots = tuple(parts)
    made: dict[int, int] = {}
    for position in _below(nodes.nodes, roots):
        node = nodes.nodes[position]
        if isinstance(node, Lit) and (true | false) >> node.atom & 1:
            made[position] = builder.true if bool(true >> node.atom & 1) == node.value else builder.false
        else:
            made[position] = builder.rebuilt(node, made.__getitem__)
    return [made[part] for part in roots]


def _below(nodes: Sequence[NormalNode], roots: Iterable[int]) -> list[int]:
    """Returns the positions of some nodes and of everything below them, parts before what they are in."""
    seen = set(roots)
    pending = list(seen)
    while pending:
        for part in inside(nodes[pending.pop()]):
            if part not in seen:
                seen.add(part)
                pending.append(part)
    return sorted(seen)
