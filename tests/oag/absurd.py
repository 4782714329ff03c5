"""Plans that no robot could carry out beside neighbours that one can, as data: a scene, steps, a goal, and the verdict.

They were written before the semantics that judges them. A scene is made of words, a thing each, with its box in
centimetres. A step is a verb with its objects; it becomes a subtask with the flow that templates have for it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import oag

# Category and box [cm] of each thing by the word that its id starts with.
THINGS: dict[str, tuple[str, tuple[float, float, float]]] = {
    "apple": ("apple", (7, 7, 7)),
    "bowl": ("bowl", (14, 14, 7)),
    "bottle": ("bottle", (5, 5, 25)),
    "box": ("box", (20, 20, 12)),
    "cup": ("cup", (8, 8, 10)),
    "glass": ("water_glass", (5, 5, 12)),
    "mug": ("mug", (7, 7, 7)),
    "plate": ("plate", (20, 20, 2)),
    "pot": ("pot", (22, 22, 18)),
    "smallbox": ("box", (5.8, 5.8, 8)),
    "spoon": ("spoon", (20, 4, 2)),
    "tray": ("tray", (40, 30, 3)),
    "cabinet": ("cabinet", (80, 50, 180)),
    "drawer": ("drawer", (50, 40, 20)),
    "refrigerator": ("refrigerator", (70, 70, 180)),
    "microwave": ("microwave", (50, 40, 30)),
    "piano": ("piano", (150, 60, 120)),
    "table": ("table", (140, 70, 75)),
}


@dataclass(frozen=True)
class Plan:
    """One row: the sizes override those of `THINGS`; facts and goal are BDDL without the outermost parentheses."""

    name: str
    things: str
    facts: tuple[str, ...]
    steps: tuple[str, ...]
    goal: str
    sizes: dict[str, tuple[float, float, float]] = field(default_factory=dict)

    def scene(self) -> oag.Scene:
        """Return the scene, in which what lies where is known completely."""
        objects = {name: self._thing(name) for name in self.things.split()}
        facts = [f"({fact})" for fact in self.facts]
        robot = {"position": [0, 0, 0], "yaw": 0.0, "scale": 1.0}
        closed = ["ontop", "inside", "open"]
        return oag.Scene.from_json(
            {"name": "small", "robot": robot, "objects": objects, "facts": facts, "closed": closed}
        )

    def task(self) -> oag.Task:
        """Return the plan as a task with a given goal."""
        subtasks = [subtask(step) for step in self.steps]
        return oag.Task.from_json({"goal": f"({self.goal})", "sub_tasks": subtasks}, scene=self.scene())

    def _thing(self, name: str) -> dict[str, Any]:
        category, box_cm = THINGS[name.partition("_")[0]]
        box_cm = self.sizes.get(name, box_cm)
        return {"category": category, "bbox_extent": [side / 100 for side in box_cm], "position": [1, 0, 0.5]}


def subtask(step: str) -> dict[str, Any]:
    """Return the subtask of `open f`, `close f`, `pick x from s` or `put x on s`; `with` gives moves on the way."""
    words, _, extra = step.partition(" with ")
    moves = [{number: float(value)} for number, value in (move.split(":") for move in extra.split())]
    verb, target, *rest = words.split()
    if verb in ("open", "close"):
        flow: list[Any] = [17, 1, 2, 3, *moves, 4 if verb == "open" else 19, 5, 6]
        said = f"(open {target})"
        denied = f"(not {said})"
        init, goal = (denied, said) if verb == "open" else (said, denied)
        return {"target": target, "init": init, "goal": goal, "flow": flow}
    support = rest[1]
    if verb == "pick":
        relation = "inside" if rest[0] == "out_of" else "ontop"
        place = f"({relation} {target} {support})"
        flow = [17, *moves, 1, 2, 3, {"7": None}, 6]
        return {
            "target": target,
            "support_init": support,
            "init": place,
            "goal": f"(inside {target} gripper)",
            "flow": flow,
        }
    relation = "inside" if rest[0] == "in" else "ontop"
    return {
        "target": target,
        "support_goal": support,
        "init": f"(inside {target} gripper)",
        "goal": f"({relation} {target} {support})",
        "flow": [18, *moves, {"8": None}, 5, 6],
    }


_KITCHEN = "apple_0 bowl_0 refrigerator_0 table_0"
_BOWL_WITH_APPLE = ("ontop bowl_0 table_0", "inside apple_0 bowl_0", "not (open refrigerator_0)")
_BOWL_IN = ("open refrigerator_0", "pick bowl_0 from table_0", "put bowl_0 in refrigerator_0", "close refrigerator_0")
_CHILLED = ("inside bowl_0 refrigerator_0", "inside apple_0 bowl_0", "not (open refrigerator_0)")
_BOWL_OUT = ("open refrigerator_0", "pick bowl_0 out_of refrigerator_0", "put bowl_0 on table_0")
_NESTED = "apple_0 drawer_0 cabinet_0 table_0"
_IN_DRAWER = ("inside apple_0 drawer_0", "inside drawer_0 cabinet_0")
_OUTSIDE = ("ontop apple_0 table_0", "inside drawer_0 cabinet_0")
_STACK = "plate_0 tray_0 apple_0 table_0 refrigerator_0"
_ON_TRAY = ("ontop tray_0 table_0", "ontop plate_0 tray_0", "ontop apple_0 plate_0")
_TWO = ("ontop apple_0 table_0", "ontop bowl_0 table_0", "ontop pot_0 table_0")
_GLASS = ("ontop glass_0 table_0", "not (open refrigerator_0)")
_GLASSES = ("ontop glass_0 table_0", "ontop glass_1 table_0", "ontop smallbox_0 table_0")

ABSURD = (
    # What is carried goes along.
    Plan("cargo is not in", _KITCHEN, _BOWL_WITH_APPLE, _BOWL_IN, "not (inside apple_0 refrigerator_0)"),
    Plan("cargo stays in", _KITCHEN, _CHILLED, _BOWL_OUT, "inside apple_0 refrigerator_0"),
    Plan(
        "cargo of cargo is not in",
        _STACK,
        _ON_TRAY,
        ("open refrigerator_0", "pick tray_0 from table_0", "put tray_0 in refrigerator_0"),
        "not (inside apple_0 refrigerator_0)",
        {"tray_0": (40, 7, 3)},
    ),
    Plan(
        "cargo of cargo stays in",
        _STACK,
        ("inside tray_0 refrigerator_0", "ontop plate_0 tray_0", "ontop apple_0 plate_0"),
        ("open refrigerator_0", "pick tray_0 out_of refrigerator_0", "put tray_0 on table_0"),
        "inside apple_0 refrigerator_0",
        {"tray_0": (40, 7, 3)},
    ),
    Plan(
        "a bowl in a box that goes in",
        "apple_0 bowl_0 box_0 refrigerator_0 table_0",
        ("ontop box_0 table_0", "inside bowl_0 box_0", "inside apple_0 bowl_0"),
        ("open refrigerator_0", "pick box_0 from table_0", "put box_0 in refrigerator_0"),
        "not (inside apple_0 refrigerator_0)",
        {"box_0": (7, 20, 12)},
    ),
    Plan(
        "both places at once",
        _KITCHEN,
        _CHILLED,
        (*_BOWL_OUT, "close refrigerator_0"),
        "and (ontop bowl_0 table_0) (inside apple_0 refrigerator_0)",
    ),
    Plan(
        "put in later, taken along",
        _KITCHEN,
        ("inside bowl_0 refrigerator_0", "ontop apple_0 table_0"),
        (
            "open refrigerator_0",
            "pick apple_0 from table_0",
            "put apple_0 in bowl_0",
            "pick bowl_0 out_of refrigerator_0",
            "put bowl_0 on table_0",
        ),
        "inside apple_0 refrigerator_0",
    ),
    Plan(
        "what is put into a bowl in a refrigerator is not in it",
        _KITCHEN,
        ("inside bowl_0 refrigerator_0", "ontop apple_0 table_0"),
        ("open refrigerator_0", "pick apple_0 from table_0", "put apple_0 in bowl_0"),
        "not (inside apple_0 refrigerator_0)",
    ),
    Plan(
        "the start denies what it says",
        _KITCHEN,
        ("inside bowl_0 refrigerator_0", "inside apple_0 bowl_0", "not (inside apple_0 refrigerator_0)"),
        (),
        "not (inside apple_0 refrigerator_0)",
    ),
    Plan("a start that is silent about it", _KITCHEN, _CHILLED, (), "not (inside apple_0 refrigerator_0)"),
    # Nothing is closed above what is taken or put down.
    Plan(
        "out of a drawer in a closed cabinet",
        _NESTED,
        (*_IN_DRAWER, "open drawer_0"),
        ("pick apple_0 out_of drawer_0",),
        "inside apple_0 gripper",
    ),
    Plan(
        "into a drawer in a closed cabinet",
        _NESTED,
        (*_OUTSIDE, "open drawer_0"),
        ("pick apple_0 from table_0", "put apple_0 in drawer_0"),
        "inside apple_0 drawer_0",
    ),
    Plan("open a drawer behind a closed door", _NESTED, _OUTSIDE, ("open drawer_0",), "open drawer_0"),
    Plan(
        "close a drawer behind a closed door",
        _NESTED,
        (*_OUTSIDE, "open drawer_0"),
        ("close drawer_0",),
        "not (open drawer_0)",
    ),
    Plan(
        "out of a bowl in a closed refrigerator",
        _KITCHEN,
        _CHILLED,
        ("pick apple_0 out_of bowl_0",),
        "inside apple_0 gripper",
    ),
    Plan(
        "into a bowl in a closed refrigerator",
        _KITCHEN,
        ("inside bowl_0 refrigerator_0", "ontop apple_0 table_0"),
        ("pick apple_0 from table_0", "put apple_0 in bowl_0"),
        "inside apple_0 bowl_0",
    ),
    Plan(
        "onto a plate in a closed refrigerator",
        "plate_0 apple_0 refrigerator_0 table_0",
        ("inside plate_0 refrigerator_0", "ontop apple_0 table_0"),
        ("pick apple_0 from table_0", "put apple_0 on plate_0"),
        "ontop apple_0 plate_0",
    ),
    Plan(
        "off a plate in a closed refrigerator",
        "plate_0 apple_0 refrigerator_0 table_0",
        ("inside plate_0 refrigerator_0", "ontop apple_0 plate_0"),
        ("pick apple_0 from plate_0",),
        "inside apple_0 gripper",
    ),
    Plan(
        "closed with the bowl, then taken out of it",
        _KITCHEN,
        _BOWL_WITH_APPLE,
        (*_BOWL_IN, "pick apple_0 out_of bowl_0"),
        "inside apple_0 gripper",
    ),
    Plan(
        "put into a bowl that was shut in",
        _KITCHEN,
        ("ontop bowl_0 table_0", "ontop apple_0 table_0"),
        (*_BOWL_IN, "pick apple_0 from table_0", "put apple_0 in bowl_0"),
        "inside apple_0 bowl_0",
    ),
    # No cycles.
    Plan(
        "a pot into the bowl that it carries",
        "pot_0 bowl_0 apple_0 table_0",
        ("ontop pot_0 table_0", "inside bowl_0 pot_0"),
        ("pick pot_0 from table_0", "put pot_0 in bowl_0"),
        "inside pot_0 bowl_0",
        {"pot_0": (7, 7, 8), "bowl_0": (14, 14, 12)},
    ),
    Plan(
        "a tray onto the plate that it carries",
        _STACK,
        _ON_TRAY,
        ("pick tray_0 from table_0", "put tray_0 on plate_0"),
        "ontop tray_0 plate_0",
        {"tray_0": (40, 7, 3)},
    ),
    Plan(
        "a tray onto the apple on its plate",
        _STACK,
        _ON_TRAY,
        ("pick tray_0 from table_0", "put tray_0 on apple_0"),
        "ontop tray_0 apple_0",
        {"tray_0": (40, 7, 3)},
    ),
    Plan(
        "a start in a circle",
        "pot_0 bowl_0 box_0",
        ("inside pot_0 bowl_0", "inside bowl_0 box_0", "inside box_0 pot_0"),
        (),
        "inside pot_0 bowl_0",
    ),
    Plan(
        "a start with each on or in the other",
        "pot_0 bowl_0",
        ("inside pot_0 bowl_0", "ontop bowl_0 pot_0"),
        (),
        "inside pot_0 bowl_0",
    ),
    Plan(
        "a goal in a circle",
        "pot_0 bowl_0 box_0 table_0",
        (),
        (),
        "and (inside pot_0 bowl_0) (inside bowl_0 box_0) (ontop box_0 pot_0)",
    ),
    # Numbers.
    Plan(
        "a bowl of 14 cm into a cup of 8",
        "bowl_0 cup_0 table_0",
        ("ontop bowl_0 table_0", "ontop cup_0 table_0"),
        ("pick bowl_0 from table_0", "put bowl_0 in cup_0"),
        "inside bowl_0 cup_0",
    ),
    Plan(
        "a bottle of 25 cm into a box of 5",
        "bottle_0 box_0 table_0",
        ("ontop bottle_0 table_0", "ontop box_0 table_0"),
        ("pick bottle_0 from table_0", "put bottle_0 in box_0"),
        "inside bottle_0 box_0",
        {"box_0": (5, 5, 5)},
    ),
    Plan(
        "two glasses into a box for one",
        "glass_0 glass_1 smallbox_0 table_0",
        _GLASSES,
        (
            "pick glass_0 from table_0",
            "put glass_0 in smallbox_0",
            "pick glass_1 from table_0",
            "put glass_1 in smallbox_0",
        ),
        "and (inside glass_0 smallbox_0) (inside glass_1 smallbox_0)",
    ),
    Plan(
        "a second glass where one is",
        "glass_0 glass_1 smallbox_0 table_0",
        ("inside glass_0 smallbox_0", "ontop glass_1 table_0", "ontop smallbox_0 table_0"),
        ("pick glass_1 from table_0", "put glass_1 in smallbox_0"),
        "inside glass_1 smallbox_0",
    ),
    Plan(
        "an apple into a mug as small",
        "apple_0 mug_0 table_0",
        ("ontop apple_0 table_0", "ontop mug_0 table_0"),
        ("pick apple_0 from table_0", "put apple_0 in mug_0"),
        "inside apple_0 mug_0",
    ),
    Plan(
        "a tray into a microwave",
        "tray_0 microwave_0 table_0",
        ("ontop tray_0 table_0", "open microwave_0"),
        ("pick tray_0 from table_0", "put tray_0 in microwave_0"),
        "inside tray_0 microwave_0",
        # Longer than the diagonal of 70.7 cm: one of 60 cm leans from corner to corner (see SOUND).
        {"tray_0": (75, 7, 3)},
    ),
    Plan(
        "12 m of driving before the release",
        "glass_0 refrigerator_0 table_0",
        _GLASS,
        ("open refrigerator_0", "pick glass_0 from table_0", "put glass_0 in refrigerator_0 with 13:3 13:3 13:3 13:3"),
        "inside glass_0 refrigerator_0",
    ),
    Plan(
        "12 m of driving before the grasp",
        "glass_0 refrigerator_0 table_0",
        _GLASS,
        ("pick glass_0 from table_0 with 15:3 15:3 15:3 15:3",),
        "inside glass_0 gripper",
    ),
    Plan(
        "a half turn before the release",
        "glass_0 refrigerator_0 table_0",
        _GLASS,
        ("open refrigerator_0", "pick glass_0 from table_0", "put glass_0 in refrigerator_0 with 20:180"),
        "inside glass_0 refrigerator_0",
    ),
    Plan(
        "a half turn before the grasp",
        "glass_0 refrigerator_0 table_0",
        _GLASS,
        ("pick glass_0 from table_0 with 21:90 21:90",),
        "inside glass_0 gripper",
    ),
    # Kinds.
    Plan("a piano is opened", "piano_0", (), ("open piano_0",), "open piano_0"),
)

SOUND = (
    Plan("cargo goes in", _KITCHEN, _BOWL_WITH_APPLE, _BOWL_IN, "inside apple_0 refrigerator_0"),
    Plan("cargo comes out", _KITCHEN, _CHILLED, _BOWL_OUT, "not (inside apple_0 refrigerator_0)"),
    Plan(
        "cargo stays in its bowl", _KITCHEN, _CHILLED, _BOWL_OUT, "and (inside apple_0 bowl_0) (ontop bowl_0 table_0)"
    ),
    Plan(
        "cargo of cargo goes in",
        _STACK,
        _ON_TRAY,
        ("open refrigerator_0", "pick tray_0 from table_0", "put tray_0 in refrigerator_0"),
        "and (inside apple_0 refrigerator_0) (ontop apple_0 plate_0)",
        {"tray_0": (40, 7, 3)},
    ),
    Plan(
        "cargo of cargo comes out",
        _STACK,
        ("inside tray_0 refrigerator_0", "ontop plate_0 tray_0", "ontop apple_0 plate_0"),
        ("open refrigerator_0", "pick tray_0 out_of refrigerator_0", "put tray_0 on table_0"),
        "not (inside plate_0 refrigerator_0)",
        {"tray_0": (40, 7, 3)},
    ),
    Plan(
        "what is put into a bowl in a refrigerator is in it",
        _KITCHEN,
        ("inside bowl_0 refrigerator_0", "ontop apple_0 table_0"),
        ("open refrigerator_0", "pick apple_0 from table_0", "put apple_0 in bowl_0"),
        "inside apple_0 refrigerator_0",
    ),
    Plan("a start says it through the bowl", _KITCHEN, _CHILLED, (), "inside apple_0 refrigerator_0"),
    Plan(
        "only the apple comes out",
        _KITCHEN,
        _CHILLED,
        ("open refrigerator_0", "pick apple_0 out_of bowl_0", "put apple_0 on table_0"),
        "and (inside bowl_0 refrigerator_0) (not (inside apple_0 refrigerator_0))",
    ),
    Plan(
        "out of a drawer in an opened cabinet",
        _NESTED,
        _IN_DRAWER,
        ("open cabinet_0", "open drawer_0", "pick apple_0 out_of drawer_0"),
        "inside apple_0 gripper",
    ),
    Plan(
        "into a drawer in an opened cabinet",
        _NESTED,
        _OUTSIDE,
        ("open cabinet_0", "open drawer_0", "pick apple_0 from table_0", "put apple_0 in drawer_0"),
        "and (inside apple_0 drawer_0) (inside apple_0 cabinet_0)",
    ),
    Plan(
        "a drawer behind an opened door",
        _NESTED,
        _OUTSIDE,
        ("open cabinet_0", "open drawer_0", "close drawer_0", "close cabinet_0"),
        "not (open cabinet_0)",
    ),
    Plan(
        "the bowl out of the pot, then the pot into it",
        "pot_0 bowl_0 table_0",
        ("ontop pot_0 table_0", "inside bowl_0 pot_0"),
        ("pick bowl_0 out_of pot_0", "put bowl_0 on table_0", "pick pot_0 from table_0", "put pot_0 in bowl_0"),
        "inside pot_0 bowl_0",
        {"pot_0": (7, 7, 8), "bowl_0": (14, 14, 12)},
    ),
    Plan(
        "a cup into a bowl",
        "bowl_0 cup_0 table_0",
        ("ontop bowl_0 table_0", "ontop cup_0 table_0"),
        ("pick cup_0 from table_0", "put cup_0 in bowl_0"),
        "inside cup_0 bowl_0",
        {"cup_0": (7, 7, 9)},
    ),
    Plan(
        "a bottle into a box that takes it",
        "bottle_0 box_0 table_0",
        ("ontop bottle_0 table_0", "ontop box_0 table_0"),
        ("pick bottle_0 from table_0", "put bottle_0 in box_0"),
        "inside bottle_0 box_0",
        {"box_0": (20, 20, 20)},
    ),
    Plan(
        "a tray that leans in a microwave",
        "tray_0 microwave_0 table_0",
        ("ontop tray_0 table_0", "open microwave_0"),
        ("pick tray_0 from table_0", "put tray_0 in microwave_0"),
        "inside tray_0 microwave_0",
        {"tray_0": (60, 7, 3)},
    ),
    Plan(
        "a tray as long as the diagonal of a drawer",
        "tray_0 drawer_0 table_0",
        ("ontop tray_0 table_0", "open drawer_0"),
        ("pick tray_0 from table_0", "put tray_0 in drawer_0"),
        "inside tray_0 drawer_0",
        {"tray_0": (55, 5, 5)},
    ),
    Plan(
        "a spoon that leans in a mug",
        "spoon_0 mug_0 table_0",
        ("ontop spoon_0 table_0", "ontop mug_0 table_0"),
        ("pick spoon_0 from table_0", "put spoon_0 in mug_0"),
        "inside spoon_0 mug_0",
        {"mug_0": (11.2, 8, 9)},
    ),
    Plan(
        "a quarter turn and more before the release",
        "glass_0 refrigerator_0 table_0",
        _GLASS,
        ("open refrigerator_0", "pick glass_0 from table_0", "put glass_0 in refrigerator_0 with 20:120"),
        "inside glass_0 refrigerator_0",
    ),
    Plan(
        "two glasses into a box for two",
        "glass_0 glass_1 box_0 table_0",
        ("ontop glass_0 table_0", "ontop glass_1 table_0", "ontop box_0 table_0"),
        ("pick glass_0 from table_0", "put glass_0 in box_0", "pick glass_1 from table_0", "put glass_1 in box_0"),
        "and (inside glass_0 box_0) (inside glass_1 box_0)",
    ),
    Plan(
        "one glass out, then the other in",
        "glass_0 glass_1 smallbox_0 table_0",
        ("inside glass_0 smallbox_0", "ontop glass_1 table_0", "ontop smallbox_0 table_0"),
        (
            "pick glass_0 out_of smallbox_0",
            "put glass_0 on table_0",
            "pick glass_1 from table_0",
            "put glass_1 in smallbox_0",
        ),
        "inside glass_1 smallbox_0",
    ),
    Plan(
        "an apple into a bowl",
        "apple_0 bowl_0 table_0",
        ("ontop apple_0 table_0", "ontop bowl_0 table_0"),
        ("pick apple_0 from table_0", "put apple_0 in bowl_0"),
        "inside apple_0 bowl_0",
    ),
    Plan(
        "half a metre to the left before the release",
        "glass_0 refrigerator_0 table_0",
        _GLASS,
        ("open refrigerator_0", "pick glass_0 from table_0", "put glass_0 in refrigerator_0 with 15:0.45 13:0.3"),
        "inside glass_0 refrigerator_0",
    ),
    Plan(
        "there and back, left and right",
        "glass_0 refrigerator_0 table_0",
        _GLASS,
        ("pick glass_0 from table_0 with 13:3 14:3 20:150 21:150",),
        "inside glass_0 gripper",
    ),
    Plan("a piano that the scene calls closed", "piano_0", ("not (open piano_0)",), ("open piano_0",), "open piano_0"),
)


def rows() -> Iterator[tuple[Plan, bool]]:
    """Yield every plan with whether it can be carried out."""
    yield from ((plan, False) for plan in ABSURD)
    yield from ((plan, True) for plan in SOUND)
