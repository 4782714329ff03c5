"""The household benchmark: 34 rooms, each with three variations and a simple task for each, 102 pairs a seed.

    from executor.scenes import household

    pair = household.pair(13000, 4)          # the fifth of the 102 pairs of this seed, without building the others
    for pair in household.pairs(13000): ...

What a room has, where, and what is asked in it is written in `data/*.toml`; models, sizes, hinge sides, handles and
places are drawn from the seed.

Source: the paper's appendix "Scalable Scene Generation Statistics" (16 kitchens, 10 bedrooms, 8 others, three
variations each; 36 pairs open or close something, 66 pick something up).
"""

from executor.scenes.household.arrange import COUNT, VARIATIONS, pair, pairs
from executor.scenes.household.layouts import Layout, LayoutError, Wish, layouts

__all__ = ["COUNT", "VARIATIONS", "Layout", "LayoutError", "Wish", "layouts", "pair", "pairs"]
