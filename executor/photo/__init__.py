"""From a photograph with depth to a scene: what was seen, fitted by parametric models of the library.

    photo -> inputs (picture, depth, camera, boxes) -> space (floor, walls) -> fitting (furniture, then items) -> scene

Frames: a camera looks along +z, x right, y down, as in OpenCV. The level frame has its origin on the floor under the
camera, z up, and x where the camera looks; the reconstructed scene is in it.
"""
