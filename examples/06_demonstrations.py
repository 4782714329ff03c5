"""Make demonstrations, look into the store, and export them for LeRobot.

A store holds one folder for each episode and resumes after any end. Everything in it follows from the seeds: the
exported data set is the same file by file when it is made again. Needs the extras `sim` and `data`.

    python examples/06_demonstrations.py [FOLDER]
"""

import sys
from pathlib import Path

from executor import EpisodeStore
from executor.cli.app import run

KITCHEN = Path(__file__).parent / "policies" / "kitchen.json"


def make_store(folder):
    """Return a store of two demonstrations; one that exists is completed."""
    words = ["generate", "pick up the glass", "--scene", KITCHEN, "--episodes", "2", "--seed", "62960"]
    words += ["--vary", "target", "--out", folder / "store"]
    if run([str(word) for word in words]):
        raise SystemExit(1)
    return folder / "store"


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples/demonstrations")
    store = make_store(folder)
    for episode in EpisodeStore.open(store).demonstrations():
        print(episode.name, {name: array.shape for name, array in episode.arrays.items() if name.startswith("robot_")})
    out = folder / "lerobot"
    if not out.exists() and run(["dataset", "export", str(store), "--format", "lerobot", "--out", str(out)]):
        raise SystemExit(1)
    print(*sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()), sep="\n")
