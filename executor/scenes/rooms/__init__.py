"""Laying out a room: furniture along walls and free on the floor, things on it and in it, and the robot.

    rng = np.random.default_rng(7)
    room = Room("my_kitchen", "kitchen", rng, depth_m=3.4, width_m=3.6)
    fridge = room.draw("fridge_one_door", parameters={"hinge": "right"})          # a SceneObject, not yet placed
    left, right = room.draw("cabinet_drawers"), room.draw("counter_plain")
    row(room, "east", [left, fridge, right], along_m=0.2, gaps_m=[0.0, 0.03])     # fronts look into the room
    table = stand(room, room.draw("table_four_legs"), -0.6, -0.9, yaw_rad=0.0)    # free-standing; returns its id
    place(room, room.draw("tumbler"), table, at=AtEdge("+y", (0.08, 0.16)))       # on its top, near an edge
    place(room, room.draw("can"), fridge.id, region="door_shelf_1")               # inside, on a shelf
    scatter(room, ["can", "carton", "book_lying"], table, count=3)                # clutter, without overlap
    place(room, room.draw("microwave_side_hinge"), right.id, at=(0.0, 0.0), yaw_rad=0.0)  # on the counter
    build_walls(room)                                                             # solid; only those in use
    stand_robot(room)                                                             # free floor, faces the room
    scene = room.scene()                                                          # facts and `closed` included

`Units` draws cabinets, counters and cookers of one height and depth, so that a row has one worktop.

Everything is drawn from the room's generator: equal generators and equal calls give equal scenes. What does not fit
raises `NoRoom`, which names the thing and what is in its way. `executor.scenes.settle.settle` then puts the scene
into physics.

Frames: walls are "east" (+x), "north" (+y), "west" and "south" of a rectangle around the origin. A place along a
wall is measured from its middle, to the left for somebody who faces the wall.
"""

from executor.scenes.rooms.furniture import WALLS, against, build_walls, row, row_length_m, stand, stand_robot
from executor.scenes.rooms.room import NoRoom, Room, Units
from executor.scenes.rooms.tops import AtEdge, Beside, Clearance, place, scatter

__all__ = [
    "WALLS",
    "AtEdge",
    "Beside",
    "Clearance",
    "NoRoom",
    "Room",
    "Units",
    "against",
    "build_walls",
    "place",
    "row",
    "row_length_m",
    "scatter",
    "stand",
    "stand_robot",
]
