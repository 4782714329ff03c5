"""Entangled conjuncts rewritten as a choice between forms in which costs simply add up."""

from __future__ import annotations

from bddl.errors import SearchLimit
from bddl.goals.clusters import Cluster
from bddl.goals.normal import AtLeast, Builder, Exact, NormalForm, Pairing, bits
from bddl.goals.places import Place, Search
from bddl.goals.pledges import Counted, Paired, Pledge
from bddl.goals.prices import Prices
from bddl.goals.search import Budget
from bddl.goals.substitution import assuming


def untangled(cluster: Cluster, budget: Budget, most: int) -> NormalForm | None:
    """Returns a form that the same states make true, and in which no parts that are needed together share an atom.

    The search for ways to make the cluster true is followed only until no two pledges share an atom any more. So a
    form may stand for many more ways than it has alternatives.

    Args:
        cluster: The conjuncts, which are entangled.
        budget: The steps that may be taken.
        most: The most alternatives that the form may have.

    Returns:
        The form; None when it would be too large, or when nothing makes the cluster true.
    """
    search = Search(cluster, Prices())
    alternatives: list[Place] = []
    pending = [Place.start(cluster.form.root)]
    try:
        while pending:
            budget.spend()
            settled = search.settled(pending.pop())
            if settled is None:
                continue
            place, settling = settled
            if any(search.uses(pledge, ~(place.true | place.false | place.whole)) for pledge in place.pledges):
                pending.extend(below for _, below in search.expanded(place, settling, 0))
                continue
            alternatives.append(place)
            if len(alternatives) > most:
                return None
    except SearchLimit:
        return None
    if not alternatives:
        return None
    builder = Builder(cluster.form)
    return builder.form(builder.either([_alternative(builder, place) for place in alternatives]))


def _alternative(builder: Builder, place: Place) -> int:
    """Returns the position of a form that makes true what was chosen at a place and what is pledged there."""
    rest = [_pledged(builder, pledge) for pledge in place.pledges]
    chosen = ((place.true, True), (place.false, False))
    literals = [builder.literal(atom, value) for atoms, value in chosen for atom in bits(atoms)]
    return builder.every((*literals, *assuming(builder, builder, rest, place.true, place.false)))


def _pledged(builder: Builder, pledge: Pledge) -> int:
    """Returns the position of a node that is true when a pledge is kept."""
    if isinstance(pledge, int):
        return pledge
    node = builder.nodes[pledge.position]
    match node, pledge:
        case AtLeast(parts=parts), Counted(needed=needed, left=left):
            return builder.at_least(needed, [parts[index] for index in left])
        case Exact(wanted=wanted, unwanted=unwanted), Counted(needed=needed, left=left):
            return builder.exact(needed, [wanted[index] for index in left], [unwanted[index] for index in left])
        case Pairing(cells=cells), Paired(needed=needed, rows=rows, columns=columns):
            return builder.pairing(needed, tuple(tuple(cells[row][column] for column in columns) for row in rows))
    raise TypeError(f"Nothing of {node!r} can be left.")
