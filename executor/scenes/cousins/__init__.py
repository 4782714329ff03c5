"""Scenes that Digital Cousins reconstructed from a photograph, furnished with models of the library.

    found = from_cousins("step_3_output/scene_0/scene_0_info.json")
    found.scene   # an `oag.Scene`: parametric models at the sizes and places of the file
    found.notes   # what was turned, moved, left out, in sentences

The form of the file is that of https://github.com/cremebrule/digital-cousins (step 3): objects with a category of
BEHAVIOR, a bounding box, a pose relative to the camera, and how they are mounted. Its meshes are not needed.
"""

from executor.scenes.cousins.convert import Converted, from_cousins

__all__ = ["Converted", "from_cousins"]
