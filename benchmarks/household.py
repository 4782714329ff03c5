"""The 102 household pairs of a seed: what is asked, whether it is feasible, and a picture of the rooms.

python benchmarks/household.py --seed 13000
python benchmarks/household.py --seed 13000 --sheet household.jpg
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

from PIL import Image

from executor.rollouts.feasibility import feasible
from executor.scenes.generators import household
from executor.scenes.pair import ScenePair
from executor.sim.render.cameras import global_camera
from executor.sim.render.stage import COLUMNS, Stage, contact_sheet, warm_up
from executor.sim.world import World
from executor.system.vulkan import activate
from oag import compose

TILE_PX = (320, 240)
SHEET_WIDTH_PX = 1200
JPEG_QUALITY = 80


def tabulate(pairs: list[ScenePair]) -> None:
    """Print a line for each pair, and how many are feasible."""
    passed: Counter[str] = Counter()
    for pair in pairs:
        found = feasible(compose(pair.task, scene=pair.scene), pair.scene, vary=False)
        passed[pair.family] += found.feasible
        known = [part.margin_deg for part in found.subtasks if part.margin_deg is not None]
        margin = f"{min(known):3.0f} deg" if known else ""
        print(f"{pair.id:28} {margin:7}  {pair.query}{'' if found else '   REFUSED: ' + found.reason}")
    count = Counter(pair.family for pair in pairs)
    print(", ".join(f"{family}: {passed[family]} of {count[family]}" for family in sorted(count)))


def room_sheet(pairs: list[ScenePair], columns: int = COLUMNS) -> Image.Image:
    """Return a picture with a tile for each pair, seen by its global camera; needs a Vulkan renderer."""
    activate()
    # While this small scene lives, the rooms' scenes share its shaders; compiling them anew takes seconds a tile.
    shaders = warm_up()
    sheet = contact_sheet([(_tile(pair), (pair.scene.name, pair.query)) for pair in pairs], columns)
    del shaders
    return sheet


def _tile(pair: ScenePair) -> Image.Image:
    width, height = TILE_PX
    with World(pair.scene, visual=True) as world:
        # Links follow the joints that were set with the first step.
        world.step()
        stage = Stage(world, [global_camera(pair.scene, width / height)], {"global": TILE_PX})
        return Image.fromarray(stage.show(world.pack())["global"])


def main() -> None:
    """Tabulates or draws the pairs of a seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=13000)
    parser.add_argument(
        "--variation", type=int, choices=range(household.VARIATIONS), help="this one of each room alone"
    )
    parser.add_argument("--sheet", type=Path, help="draw the rooms into this file instead (the first variation)")
    options = parser.parse_args()
    variation = options.variation if options.variation is not None or options.sheet is None else 0
    step = 1 if variation is None else household.VARIATIONS
    pairs = [household.pair(options.seed, index) for index in range(variation or 0, household.COUNT, step)]
    if options.sheet is None:
        tabulate(pairs)
    else:
        sheet = room_sheet(pairs)
        sheet.thumbnail((SHEET_WIDTH_PX, 10 * SHEET_WIDTH_PX))
        sheet.save(options.sheet, quality=JPEG_QUALITY)


if __name__ == "__main__":
    main()
