"""Evaluate a policy in episodes that no policy has seen.

Rates come with exact intervals, failures by kind. The policy is the tiny one of the example before, so it fails here.
Needs the extras `sim`, `gym` and `learn`.

    python examples/08_evaluate.py [FOLDER]
"""

import importlib
import json
import sys
from pathlib import Path

from executor.cli.app import run

training = importlib.import_module("07_train")

if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples/demonstrations")
    policy = training.train(folder)
    words = ["evaluate", policy, "--episodes", "1", "--seed", "62970", "--out", folder / "results"]
    if run([str(word) for word in words]):
        raise SystemExit(1)
    result = json.loads((folder / "results" / "evaluation.json").read_text())
    for name, scores in result["policies"].items():
        print(name, scores["success_once"])
