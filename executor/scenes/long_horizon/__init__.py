"""The paper's four long-horizon tasks, each in a kitchen drawn from a seed.

    pair = draw("T2", seed=12000)
    executor.rollout(oag.compose(pair.task, scene=pair.scene), pair.scene, seed=12000, vary=False)

| family | query | drawn |
| --- | --- | --- |
| T1 | put the glass into the refrigerator | refrigerator, its neighbours, table, clutter, shelves in use, robot |
| T2 | put the apple into the refrigerator | the same, with a whole apple or half of one |
| T3 | put the apple into the bowl | cabinets, table, which of them has the apple and which the bowl, clutter, robot |
| T4 | put the cup on the table | cabinets, table, a cup or a glass on a cabinet, clutter on both, robot |

Source: the paper's long-horizon tasks (its Section 4.2 and appendix); the ranges are ours (docs/scenes.md).
"""

from executor.scenes.long_horizon.drawing import FAMILIES, QUERIES, NoScene, draw

__all__ = ["FAMILIES", "QUERIES", "NoScene", "draw"]
