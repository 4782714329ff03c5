"""Check a proof with a program that follows the plan on its own.

A certificate lists, for every requirement of every step, who made it true. The checker reads the certificate alone, and
shares with the prover only the language, the primitives' table and the facts. A certificate that was tampered with is
rejected.

    python examples/11_recheck.py
"""

import importlib
import json

import oag

first = importlib.import_module("01_verify")

if __name__ == "__main__":
    scene = oag.Scene.from_json(first.SCENE)
    report = oag.compose(oag.Task.from_json(first.TASK, scene=scene)).verify()
    certificate = json.loads(json.dumps(report.certificate.to_json()))
    print("as written:", oag.recheck(certificate))
    certificate["links"] = certificate["links"][1:]
    tampered = oag.recheck(certificate)
    print("one link removed:", tampered)
    if tampered:
        raise SystemExit(1)
