"""Describe a scene of your own in a few lines, and plan in it.

Category and place are enough. Models and sizes come from the library, and what stands on or in what follows from
geometry. A scene that cannot be is refused with its reasons: here, a sofa in the place of a table.

    python examples/04_own_scene.py
"""

import llm
import oag
from executor.scenes.file import complete_scene
from executor.scenes.validation import issues

SCENE = {
    "name": "my_kitchen",
    "robot": {"position": [-0.6, 0.6]},
    "objects": {
        "fridge_0": {"category": "refrigerator", "position": [1.2, 1.2], "heading_deg": 0.0},
        "table_0": {"category": "table", "model": "table_four_legs", "position": [0.9, -0.6]},
        "apple_0": {"category": "apple", "on": "table_0", "at": [-0.1, 0.1]},
        "bowl_0": {"category": "bowl", "on": "table_0", "at": [0.0, -0.2]},
    },
}

if __name__ == "__main__":
    completed = complete_scene(SCENE)
    assert completed.scene is not None, completed.problems
    scene = completed.scene
    for name, thing in scene.objects.items():
        print(f"{name:10} {thing.model:20} {' x '.join(f'{side:.2f}' for side in thing.bbox_extent)} m")
    print("facts:", ", ".join(str(fact) for fact in scene.facts))
    print(oag.compose(llm.propose("put the apple into the bowl", scene).task).verify().verdict)
    there = SCENE["objects"] | {"sofa_0": {"category": "sofa", "position": [0.9, -0.6]}}
    crowded = complete_scene(SCENE | {"objects": there})
    found = [*crowded.problems, *(issues(crowded.scene) if crowded.scene else ())]
    print("with a sofa in the table's place:", *found, sep="\n  ")
    if not found:
        raise SystemExit(1)
