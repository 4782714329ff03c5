"""Break a plan and read why it fails.

A wrong plan is data: `verify` says which step needs what, who last changed it and since when, and gives a start from
which the plan fails. Here the subtask that opens the refrigerator is forgotten.

    python examples/09_counterexample.py
"""

import copy
import importlib

import oag

first = importlib.import_module("01_verify")

if __name__ == "__main__":
    scene = oag.Scene.from_json(first.SCENE)
    task = copy.deepcopy(first.TASK)
    del task["sub_tasks"][0]
    report = oag.compose(oag.Task.from_json(task, scene=scene)).verify()
    print(report)
    print("codes:", ", ".join(diagnostic.code for diagnostic in report.diagnostics))
    if report.verdict is not oag.Verdict.REFUTED:
        raise SystemExit(1)
