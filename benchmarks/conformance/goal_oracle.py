"""Truth of a formula by its definition, pairs matched by networkx; shares nothing with the evaluators it judges."""

from __future__ import annotations

from collections.abc import Mapping

import networkx
from networkx.algorithms import bipartite

import bddl


def oracle(
    formula: bddl.Formula,
    state: Mapping[bddl.Atom, bool],
    objects: Mapping[str, str],
    bound: Mapping[str, str] | None = None,
) -> bool:
    """Return the truth of a formula by its definition; pairs are matched by networkx."""
    bound = bound or {}
    if isinstance(formula, bddl.Atom):
        return state[bddl.Atom(formula.predicate, tuple(bound.get(name, name) for name in formula.args))]
    if isinstance(formula, bddl.ForAll | bddl.Exists | bddl.ForN):
        names = [name for name, category in objects.items() if category == formula.category]
        values = [oracle(formula.body, state, objects, {**bound, formula.variable: name}) for name in names]
        if isinstance(formula, bddl.ForN):
            return values.count(True) == formula.count
        return all(values) if isinstance(formula, bddl.ForAll) else any(values)
    if isinstance(formula, bddl.ForPairs):
        return _pairs_off(formula, state, objects, bound)
    values = [oracle(part, state, objects, bound) for part in formula.operands]
    match formula:
        case bddl.Not():
            return not values[0]
        case bddl.And():
            return all(values)
        case bddl.Or():
            return any(values)
        case bddl.Imply():
            return values[1] if values[0] else True


def _pairs_off(
    formula: bddl.ForPairs, state: Mapping[bddl.Atom, bool], objects: Mapping[str, str], bound: Mapping[str, str]
) -> bool:
    first, second = formula.binders
    rows, columns = ([name for name, category in objects.items() if category == b.category] for b in (first, second))
    graph = networkx.Graph()
    graph.add_nodes_from((0, name) for name in rows)
    graph.add_nodes_from((1, name) for name in columns)
    for row in rows:
        for column in columns:
            scope = {**bound, first.variable: row, second.variable: column}
            if row != column and oracle(formula.body, state, objects, scope):
                graph.add_edge((0, row), (1, column))
    pairs = bipartite.maximum_matching(graph, top_nodes=[(0, name) for name in rows])
    count = min(len(rows), len(columns)) if formula.number is None else formula.number
    return len(pairs) // 2 >= count
