"""Train a policy on demonstrations by behaviour cloning.

Settings are a short TOML file, or one of the built-in ones such as `ensemble`. These are tiny, so that they train in
seconds: the policy learns nothing useful. Training resumes to the same weights after any end. Needs the extra `learn`.

    python examples/07_train.py [FOLDER]
"""

import importlib
import sys
from pathlib import Path

from executor.cli.app import run

demonstrations = importlib.import_module("06_demonstrations")
SETTINGS = """
[sees]
phase = true
[acts]
chunk = 4
execute = 2
[network]
width = 32
layers = 1
[training]
steps = 50
batch = 16
"""


def train(folder):
    """Return the folder of a policy, trained on a store that is made where it is absent."""
    store = demonstrations.make_store(folder)
    (folder / "tiny.toml").write_text(SETTINGS)
    words = ["train", folder / "tiny.toml", "--data", store, "--out", folder / "policy", "--threads", "1"]
    if run([str(word) for word in words]):
        raise SystemExit(1)
    return folder / "policy"


if __name__ == "__main__":
    policy = train(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples/demonstrations"))
    print(*sorted(str(path.relative_to(policy)) for path in policy.rglob("*") if path.is_file()), sep="\n")
