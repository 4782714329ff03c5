"""Our planner on the models that GenSim2's tasks have: which can be taken, and how many are opened and shut.

    python -m benchmarks.gensim2_models CHECKOUT [--episodes 20] [--seed 0] [--out runs/gensim2_models] [KIND ...]

Every model of a kind is imported at the size that such a thing has for a Panda of 0.7 of its size, as the command
`assets import` does it, without a side file. What has a handle that fingers fit behind stands alone in a room, a
microwave or a safe on a table, and is opened, and shut from half open, from places that seeds draw for the robot. What
has none is said, and counts as not taken. Nothing of the checkout is kept but what the import makes of it, in OUT.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import sys
from pathlib import Path
from typing import Any

from executor.assets.importers.files import ImportRefused
from executor.assets.importers.importer import import_asset
from executor.cli.app import run
from executor.system.files import write_json

KINDS: dict[str, tuple[str, str, float, bool]] = {
    "refrigerator": ("refrigerator", "refrigerator", 1.2, False),
    "drawer": ("drawer", "cabinet", 0.6, False),
    "microwave": ("microwave", "microwave", 0.3, True),
    "safe": ("safe_rotate", "safe", 0.35, True),
}
"""Name -> folder of the checkout, category, height in m, and whether it stands on a table."""

TABLE_M = (0.8, 1.2, 0.5)
_AWAY_M = 0.9  # From a front to where the robot begins.
_HALF_OPEN = 0.5


def main() -> int:
    """Imports the models, has them opened and shut, and prints a line each; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path, help="a checkout of GenSim2, with its assets")
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(KINDS)}; by default all")
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/gensim2_models"))
    options = parser.parse_args()
    options.kinds = options.kinds or [*KINDS]
    if unknown := [kind for kind in options.kinds if kind not in KINDS]:
        parser.error(f"KIND {unknown[0]!r}: expected of {', '.join(KINDS)}")
    models = options.checkout / "assets" / "articulated_objs"
    if not models.is_dir():
        parser.error(f"CHECKOUT {options.checkout}: expected a checkout of GenSim2, which has {models}")
    os.environ["SCENE2DEMO_ASSETS"] = str(options.out.absolute() / "assets")
    rows: list[dict[str, Any]] = []
    for kind in options.kinds:
        for source in sorted(path for path in (models / KINDS[kind][0]).iterdir() if path.is_dir()):
            rows.append({"kind": kind, "model": source.name, **_measured(kind, source, options)})
            print(_line(rows[-1]), flush=True)
    for kind in options.kinds:
        own = [row for row in rows if row["kind"] == kind]
        done, tried = (sum(count[place] for row in own for count in row.get("counts", {}).values()) for place in (0, 1))
        taken = sum("counts" in row for row in own)
        print(f"{kind}: {taken} of {len(own)} models taken, {done} of {tried} episodes succeeded")
    write_json(options.out / "rows.json", {"schema": "scene2demo-gensim2-models/1", "rows": rows})
    return 0


def _measured(kind: str, source: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Return what became of one model: why it was not taken, or how often it was opened and shut."""
    _, category, height_m, on_table = KINDS[kind]
    name = f"{kind}_{source.name}"
    try:
        imported = import_asset(source, name=name, category=category, height_m=height_m)
    except ImportRefused as refused:
        return {"refused": str(refused)}
    asset = imported.stored.asset
    if not asset.handles:
        return {"refused": "; ".join(imported.stored.notes) or "it has no handle"}
    counts: dict[str, tuple[int, int, dict[str, int]]] = {}
    for verb, fraction in (("open", 0.0), ("close", _HALF_OPEN)):
        folder = options.out / name / verb
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "scene.json", _scene(name, category, asset.extent_m, on_table, fraction))
        words = ["generate", f"{verb} the {category}", "--scene", folder / "scene.json", "--episodes", options.episodes]
        words += ["--seed", options.seed, "--workers", 1, "--out", folder / "store", "--json"]
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            run([str(word) for word in words])
        told = json.loads(printed.getvalue())
        if "error" in told:
            return {"refused": told["error"]["message"]}
        counts[verb] = told["endings"].get("succeeded", 0), options.episodes, told["failures"]
    return {"counts": counts}


def _scene(name: str, category: str, extent_m: tuple[float, float, float], on_table: bool, opened: float) -> Any:
    depth_m, _, height_m = extent_m
    floor_m = TABLE_M[2] if on_table else 0.0
    thing = {
        "category": category,
        "model": f"imported/{name}",
        "position": [0.0, 0.0, floor_m + height_m / 2],
        "orientation": [1, 0, 0, 0],
        "bbox_extent": list(extent_m),
        "scale": [1, 1, 1],
        "parameters": {"open_fraction": opened},
    }
    objects = {f"{category}_0": thing}
    if on_table:
        objects["table_0"] = {
            "category": "table",
            "model": "four_legs",
            "position": [TABLE_M[0] / 2 - depth_m / 2 - 0.02, 0.0, TABLE_M[2] / 2],
            "orientation": [1, 0, 0, 0],
            "bbox_extent": list(TABLE_M),
            "scale": [1, 1, 1],
        }
    is_open = f"(open {category}_0)"
    return {
        "name": name,
        "robot": {"position": [-depth_m / 2 - _AWAY_M, 0.0, 0.0], "yaw": 0.0},
        "objects": objects,
        "facts": [is_open if opened else f"(not {is_open})"],
        "closed": ["ontop", "inside", "open"],
        "variation": {"robot": {"dx_m": [-0.1, 0.1], "dy_m": [-0.3, 0.3], "dyaw_rad": [-0.2, 0.2]}},
    }


def _line(row: dict[str, Any]) -> str:
    head = f"{row['kind']} {row['model']}: "
    if "refused" in row:
        return head + f"not taken: {row['refused']}"
    said = []
    for verb, (done, tried, failures) in row["counts"].items():
        kinds = ", ".join(f"{count} {kind}" for kind, count in failures.items())
        said.append(f"{verb} {done} of {tried}" + (f" ({kinds})" if kinds else ""))
    return head + ", ".join(said)


if __name__ == "__main__":
    sys.exit(main())
