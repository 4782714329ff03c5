"""What literals cost, and how the price of one that is used in several places is split among them."""

from __future__ import annotations

from typing import NamedTuple

from bddl.goals.clusters import Cluster, entangled
from bddl.goals.normal import Lit, NormalForm, inside

# Prices of shared literals are split among their uses and rounded down; this number has many divisors.
_PARTS_OF_A_PRICE = 5040
# More uses than this are not counted, so that the shares of a price stay whole numbers of a handy size.
_MOST_USES = 1 << 20


class Prices(NamedTuple):
    """What literals cost: 1 each, and `surcharge` more for those that do not hold yet.

    Attributes:
        true: Atoms known to be true, as a set of bits.
        false: Atoms known to be false.
        surcharge: A whole number from 0.
    """

    true: int = 0
    false: int = 0
    surcharge: int = 0

    def of(self, true: int, false: int) -> int:
        """Returns the price of making some atoms true and others false."""
        changed = (true & ~self.true).bit_count() + (false & ~self.false).bit_count()
        return true.bit_count() + false.bit_count() + self.surcharge * changed

    def of_literal(self, literal: Lit) -> int:
        """Returns the price of one literal."""
        bit = 1 << literal.atom
        return self.of(bit, 0) if literal.value else self.of(0, bit)


class Shares:
    """Shares of prices, such that their sums over a cluster never exceed what its literals cost together.

    In a cluster that is not entangled, a share is the whole price. Else a literal's price is split evenly among the
    places that use it.

    Args:
        cluster: The cluster whose literals have prices.

    Attributes:
        scale: How many units a price of 1 has.
        tangled: For each node, whether it or a node below it is entangled.
    """

    __slots__ = ("_uses", "scale", "tangled")

    def __init__(self, cluster: Cluster) -> None:
        form = cluster.form
        self.tangled: list[bool] = []
        self._uses: list[int] = []
        self.scale = 1
        if cluster.entangled:
            for node in form.nodes:
                self.tangled.append(entangled(form, node) or any(self.tangled[part] for part in inside(node)))
            self._uses = _uses(form)
            self.scale = max(_PARTS_OF_A_PRICE, *self._uses)

    def share(self, literal: Lit, price: int) -> int:
        """Returns the share of a literal's price that each of its places pays."""
        return self.scale * price // self._uses[2 * literal.atom + literal.value] if self._uses else price


def _uses(form: NormalForm) -> list[int]:
    """Returns how many paths lead from the root to each literal: to "atom 0 is false", "atom 0 is true", and so on."""
    paths = [0] * len(form.nodes)
    paths[form.root] = 1
    uses = [1] * (2 * form.atoms[form.root].bit_length())
    for position in range(form.root, -1, -1):
        node = form.nodes[position]
        if isinstance(node, Lit):
            uses[2 * node.atom + node.value] = max(1, paths[position])
        for part in inside(node):
            paths[part] = min(paths[part] + paths[position], _MOST_USES)
    return uses
