"""Turn a photograph with depth into a scene in which a plan is proved.

The photograph here is drawn from a known scene, with its depth, the camera and a box around each thing, so that the
result can be compared. Your own needs the same files: a picture, a depth image and boxes with names. Needs the extras
`sim` and `photo`, and a Vulkan driver (`scene2demo doctor` tells).

    python examples/05_photograph.py [FOLDER]
"""

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

import llm
import oag
from executor.bench.photo.truth import photograph, photographer
from executor.cli.app import run
from executor.scenes.file import complete_scene, load_scene

ROOM = {
    "name": "corner",
    "robot": {"position": [-1.6, 1.6]},
    "objects": {
        "table_0": {"category": "table", "model": "table_four_legs", "position": [0.0, 0.0], "heading_deg": 12.0},
        "bowl_0": {"category": "bowl", "on": "table_0", "at": [0.1, 0.1]},
        "apple_0": {"category": "apple", "on": "table_0", "at": [-0.1, -0.1]},
    },
}


def write_photograph(folder):
    """Write picture, depth, camera and boxes of the room."""
    with photographer():
        shot = photograph(complete_scene(ROOM).scene, seed=62001, size_px=(480, 360))
    Image.fromarray(shot.rgb).save(folder / "room.png")
    Image.fromarray(np.round(1000 * shot.depth_m).astype(np.uint16)).save(folder / "depth.png")
    (folder / "camera.json").write_text(json.dumps({"K": shot.K.tolist()}))
    things = []
    for name, mask in shot.visible().items():
        rows, columns = np.nonzero(mask)
        box = [int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1]
        things.append({"label": shot.scene.objects[name].category, "box": box})
    (folder / "boxes.json").write_text(json.dumps({"things": things}))


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples/photograph")
    folder.mkdir(parents=True, exist_ok=True)
    write_photograph(folder)
    words = ["photo", folder / "room.png", "--depth", folder / "depth.png", "--boxes", folder / "boxes.json"]
    words += ["--camera", folder / "camera.json", "--out", folder / "scene", "--force"]
    if run([str(word) for word in words]):
        raise SystemExit(1)
    scene = load_scene(folder / "scene" / "scene.json")
    for name, thing in scene.objects.items():
        print(f"{name:14} {thing.model:18} at {', '.join(f'{value:.2f}' for value in thing.position)} m")
    print(oag.compose(llm.propose("put the apple into the bowl", scene).task).verify().verdict)
