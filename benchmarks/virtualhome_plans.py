"""Which plans for VirtualHome are refuted, and which of these get a fix that proves.

    python -m benchmarks.virtualhome_plans FOLDER [--by people | --by MODEL ...] [--half tuning] [--no-goal] [--show]

FOLDER is a checkout of github.com/Aytacabd/embodied-agent-interface (MIT), a fork of the Embodied Agent Interface. It
has the action sequences that 18 language models wrote for VirtualHome (`action_sequencing/MODEL/error_info.json`), the
programs that people wrote for the same tasks (`executable_programs`), and the graph of each task's home
(`init_and_final_graphs`). Nothing of it is kept here, and nothing of it is executed.

A home becomes a scene: what the plan names, what that stands on or lies in, the floor, and furniture with a top. What
can be grabbed is an item, what can be opened a fixture, anything else a support. Steps of the hand become simple tasks
as the planner writes them: GRAB picks a thing up from where it then is, PUTBACK, PUTIN, PUTOBJBACK and PUTON (with a
place) put it down, DROP and RELEASE put it on the floor, OPEN and CLOSE move a door. All others (WALK, FIND, SWITCHON,
READ, ...) write nothing that the predicates can say. The task goal is what the steps leave: places, doors, and in the
hand the thing that was taken last. With --no-goal the task states none.

A plan that is outside the language is counted and left out: none of its steps moves anything (still), it names what the
home lacks (unknown), or it opens a thing to be carried or moves a fixture (kind).

Halves are drawn by a hash of the task's name, so that all plans of a task are in one: a half is for tuning, the other
for judging once.

    agree    verdicts that equal those of a simulator of one hand and doors, which shares nothing with the graph
    fixed    refuted plans with a fix that proves; each is applied, and verified again
    leading  refuted plans whose first error says what the simulator stops at: a full or an empty hand, a closed door
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import bddl
import oag
from executor.campaign.rate import Rate
from oag.model.symbols import GRIPPER, Kind, kind_of, takes_things
from oag.primitives.cargo import RESTING
from oag.primitives.table import Placement
from oag.verify.fix_subtasks import closing, opening, picking, placing
from oag.wellformed import kind_problem

PEOPLE = "people"
_STEP = re.compile(r"\[\s*(?P<verb>\w+)\s*\]|<(?P<name>[^>]+)>\s*\((?:\d+\.)?(?P<id>\d+)\)")
_PUT, _LET_GO = ("PUTBACK", "PUTOBJBACK", "PUTIN", "PUTON"), ("DROP", "RELEASE")
_HANDS = (*_PUT, *_LET_GO, "GRAB", "OPEN", "CLOSE")
_FLOOR = "floor_0"
# Categories that stand for others, which mean another kind here than there.
_STANDS_FOR = {Kind.ITEM: "thing", Kind.ARTICULATED: "cabinet", Kind.SUPPORT: "table"}
_SIDES_M = {Kind.ITEM: 0.03, Kind.ARTICULATED: 0.6, Kind.SUPPORT: 0.8}
_FURNITURE = ("Furniture",)
_VESSEL_SIDE_M = 0.05  # Of an item that others go into; a home has no sizes, and these stand in no way.


class Outside(ValueError):
    """A plan says what these predicates cannot; the text is its kind."""


@dataclass(frozen=True)
class Plan:
    """One plan, with the home that it is for.

    Attributes:
        author: Name of the model, or `PEOPLE`.
        name: Of the task.
        steps: Verb, and the ids of the objects, of every step.
        graph: File of the home's graph.
    """

    author: str
    name: str
    steps: tuple[tuple[str, tuple[str, ...]], ...]
    graph: Path

    @property
    def is_tuning(self) -> bool:
        """Whether the plan is in the half for tuning."""
        return hashlib.sha256(self.name.encode()).digest()[0] % 2 == 0


def plans(folder: Path, authors: Sequence[str]) -> Iterator[Plan]:
    """Yield the plans of some authors whose homes there are: of the named ones, else of all models and people."""
    graphs = {
        path.stem.removeprefix("file"): path for path in sorted(folder.glob("**/init_and_final_graphs/**/*.json"))
    }
    for path in sorted(folder.glob("action_sequencing/*/error_info.json")):
        if not authors or path.parent.name in authors:
            for name, entry in sorted(json.loads(path.read_text(encoding="utf-8")).items()):
                # Where an action could not be read, it is no text.
                lines = [line for line in entry["actions"] or () if isinstance(line, str)]
                if name in graphs and lines:
                    yield Plan(path.parent.name, name, tuple(map(_step, lines)), graphs[name])
    if authors and PEOPLE not in authors:
        return
    for path in sorted(folder.glob("**/executable_programs/**/*.txt")):
        lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("[")]
        if (name := path.stem.removeprefix("file")) in graphs:
            yield Plan(PEOPLE, name, tuple(map(_step, lines)), graphs[name])


def _step(line: str) -> tuple[str, tuple[str, ...]]:
    verb, ids = "", []
    for found in _STEP.finditer(line):
        if found["verb"]:
            verb = found["verb"].upper()
        else:
            ids.append(found["id"])
    return verb, tuple(ids)


@dataclass
class Home:
    """The part of a home that a plan is about.

    Attributes:
        names: Number of a node -> id of its object.
        objects: Objects as a scene file says them.
        resting: Item -> relation and support at the start.
        ajar: Fixture -> whether it is open at the start.
    """

    names: dict[str, str] = field(default_factory=dict)
    objects: dict[str, Any] = field(default_factory=dict)
    resting: dict[str, Placement] = field(default_factory=dict)
    ajar: dict[str, bool] = field(default_factory=dict)

    def scene(self, name: str) -> oag.Scene:
        """Return the home as a scene."""
        facts = [f"({there.relation} {item} {there.support})" for item, there in self.resting.items()]
        facts += [f"(open {key})" if is_open else f"(not (open {key}))" for key, is_open in self.ajar.items()]
        content = {"name": name, "objects": self.objects, "facts": facts, "closed": ["ontop", "inside", "open"]}
        return oag.Scene.from_json(content)


_Holders = dict[str, list[str]]


@cache
def _graph(path: Path) -> tuple[dict[str, dict[str, Any]], _Holders, _Holders]:
    """Return the nodes of a home by number, and the numbers of what each is inside and on."""
    graph = json.loads(path.read_text(encoding="utf-8"))["init_graph"]
    holders: dict[str, _Holders] = {"INSIDE": {}, "ON": {}}
    for edge in graph["edges"]:
        if edge["relation_type"] in holders:
            holders[edge["relation_type"]].setdefault(str(edge["from_id"]), []).append(str(edge["to_id"]))
    return {str(node["id"]): node for node in graph["nodes"]}, holders["INSIDE"], holders["ON"]


def home_of(plan: Plan) -> Home:
    """Return the home of a plan: what its hands touch, and what holds that.

    Raises:
        Outside: The plan names what the home lacks.
    """
    nodes, inside, on = _graph(plan.graph)
    home = Home(objects={_FLOOR: _object("floor", Kind.SUPPORT)})

    def add(number: str) -> str:
        if number in home.names:
            return home.names[number]
        if number not in nodes:
            raise Outside("unknown")
        node = nodes[number]
        category = re.sub(r"[^a-z0-9]+", "_", node["class_name"].lower()).strip("_") or "thing"
        if category == "floor":
            return _FLOOR
        kind = _kind(node)
        name = home.names[number] = f"{category}_{number}"
        home.objects[name] = _object(category, kind)
        if kind is Kind.ARTICULATED:
            home.ajar[name] = "OPEN" in node["states"]
        elif kind is Kind.ITEM:
            # A thing in a room lies inside the room as well, and what is in a drawer is also in its cabinet.
            around = [other for other in inside.get(number, ()) if nodes[other]["category"] != "Rooms"]
            around.sort(key=lambda other: -len(inside.get(other, ())))
            below = [other for other in on.get(number, ()) if nodes[other]["category"] != "Rooms"]
            holder = next((add(other) for other in (*around[:1], *below[:1])), _FLOOR)
            home.resting[name] = _place(name, holder, home, wants_inside=bool(around))
        return name

    for verb, ids in plan.steps:
        if verb in _HANDS:
            for number in ids:
                add(number)
    for number, node in nodes.items():
        if "SURFACES" in node["properties"] and node["category"] in _FURNITURE and _kind(node) is Kind.SUPPORT:
            add(number)
    return home


def _object(category: str, kind: Kind) -> dict[str, Any]:
    side_m = _SIDES_M[kind]
    known = kind_of(category, side_m) is kind
    if known and kind is Kind.ITEM and takes_things(category, kind):
        side_m = _VESSEL_SIDE_M
    return {"category": category if known else _STANDS_FOR[kind], "bbox_extent": [side_m, side_m, side_m]}


def _kind(node: dict[str, Any]) -> Kind:
    properties = node["properties"]
    if "GRABBABLE" in properties:
        return Kind.ITEM
    return Kind.ARTICULATED if "CAN_OPEN" in properties else Kind.SUPPORT


def _place(item: str, holder: str, home: Home, *, wants_inside: bool) -> Placement:
    """Return the place of an item at a holder: inside where that is meant and can be, else on it, where that can be."""
    scene = home.scene("room")
    relations = ("inside", "ontop") if wants_inside else ("ontop", "inside")
    for relation in relations:
        if relation in RESTING and kind_problem(bddl.Atom(relation, (item, holder)), scene) is None:
            return Placement(relation, holder)
    raise Outside("kind")


@dataclass
class Reading:
    """A plan as a task, and what a simulator of one hand says of it.

    Attributes:
        stops: What the simulator stops at, and the subtask; empty where it comes to the end.
    """

    task: oag.Task
    stops: str = ""
    at: int = -1


def read(plan: Plan, *, goal_given: bool = True) -> Reading:
    """Return a plan as a task in its home.

    Raises:
        Outside: It is outside the language.
    """
    home, subtasks = home_of(plan), []
    rests, ajar, in_hands = dict(home.resting), dict(home.ajar), list[str]()
    simulated = _OneHand(dict(home.resting), dict(home.ajar))
    for verb, numbers in plan.steps:
        names = [home.names.get(number, _FLOOR) for number in numbers]
        if verb not in _HANDS or not names or (verb == "PUTON" and len(names) < 2):
            continue  # PUTON without a place dresses somebody.
        what = names[0]
        if verb in ("OPEN", "CLOSE"):
            if what not in ajar:
                raise Outside("kind")
            subtasks.append(opening(what) if verb == "OPEN" else closing(what))
            ajar[what] = verb == "OPEN"
            simulated.move_door(what, opens=verb == "OPEN")
            continue
        if what not in home.resting:
            raise Outside("kind")
        if verb == "GRAB":
            subtasks.append(picking(what, rests.get(what)))
            rests.pop(what, None)
            in_hands = [*(item for item in in_hands if item != what), what]
            simulated.grab(what)
            continue
        if len(names) < 2 and verb in _PUT:
            raise Outside("kind")
        where = _FLOOR if verb in _LET_GO else names[1]
        rests[what] = place = _place(what, where, home, wants_inside=verb == "PUTIN" or where in ajar)
        subtasks.append(placing(what, place))
        in_hands = [item for item in in_hands if item != what]
        simulated.put(what, place)
    if not subtasks:
        raise Outside("still")
    moved = {part.target for part in subtasks}
    parts = [f"(inside {item} {GRIPPER})" for item in in_hands[-1:]]
    parts += [f"({place.relation} {item} {place.support})" for item, place in rests.items() if item in moved]
    parts += [f"(open {key})" if is_open else f"(not (open {key}))" for key, is_open in ajar.items() if key in moved]
    content: dict[str, Any] = {
        "task_activity_name": f"{plan.author}_{plan.name}",
        "sub_tasks": [part.to_json() for part in subtasks],
    }
    if goal_given:
        content["goal"] = f"(and {' '.join(parts)})"
    task = oag.Task.from_json(content, scene=home.scene(f"home_{plan.name}"))
    return Reading(task, simulated.stops, simulated.at)


@dataclass
class _OneHand:
    """A simulator of one hand and of doors; it stops at the first step that cannot be done."""

    resting: dict[str, Placement]
    ajar: dict[str, bool]
    held: str = ""
    stops: str = ""
    step: int = 0
    at: int = -1

    def move_door(self, fixture: str, *, opens: bool) -> None:
        problem = "full hand" if self.held else "door" if self.ajar[fixture] is opens else ""
        if self._done(problem):
            self.ajar[fixture] = opens

    def grab(self, item: str) -> None:
        problem = "full hand" if self.held else "door" if self._shut_in(item) else ""
        if self._done(problem):
            self.held = item
            del self.resting[item]

    def put(self, item: str, place: Placement) -> None:
        behind = place.relation == "inside" and self.ajar.get(place.support) is False
        shut = behind or self._shut_in(place.support)
        itself = place.support == item
        if self._done("empty hand" if self.held != item else "door" if shut else "itself" if itself else ""):
            self.held, self.resting[item] = "", place

    def _shut_in(self, item: str) -> bool:
        """Decide whether a closed door is between the hand and a thing."""
        while (there := self.resting.get(item)) is not None:
            if there.relation == "inside" and self.ajar.get(there.support) is False:
                return True
            item = there.support
        return False

    def _done(self, problem: str) -> bool:
        if not self.stops and problem:
            self.stops, self.at = problem, self.step
        self.step += 1
        return not self.stops


def fixed(report: oag.Report) -> tuple[str, float]:
    """Return the kind of the first fix that proves, empty without one, and how long the search took [CPU s]."""
    began_s = time.process_time()
    offered = report.fixes
    took_s = time.process_time() - began_s
    for fix in offered:
        task, scene = fix.apply(report.task), fix.apply_to_scene(report.scene)
        if fix.proves and oag.compose(task, scene=scene).verify():
            return fix.kind, took_s
    return "", took_s


def main() -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--by", nargs="+", default=())
    parser.add_argument("--half", choices=("tuning", "judging"))
    parser.add_argument("--no-goal", action="store_true")
    parser.add_argument("--show", action="store_true")
    options = parser.parse_args()
    outside, verdicts, kinds, stops = Counter[str](), Counter[str](), Counter[str](), Counter[str]()
    agreed = leading = 0
    times_s: list[float] = []
    for plan in plans(options.folder, options.by):
        if options.half and plan.is_tuning is not (options.half == "tuning"):
            continue
        try:
            reading = read(plan, goal_given=not options.no_goal)
        except Outside as problem:
            outside[str(problem)] += 1
            continue
        report = oag.compose(reading.task).verify()
        verdicts[report.verdict.value] += 1
        agreed += (report.verdict is oag.Verdict.PROVED) is (not reading.stops)
        if options.show and (report.verdict is oag.Verdict.PROVED) is not (not reading.stops):
            print(f"DISAGREE {reading.task.name} at T{reading.at + 1}: {reading.stops}\n{report}\n")
        if report.verdict is not oag.Verdict.REFUTED:
            continue
        stops[reading.stops] += 1
        first = report.errors[0]
        leading += first.subtask == reading.at
        kind, took_s = fixed(report)
        kinds[kind or "none"] += 1
        times_s.append(took_s)
        if options.show and (not kind or took_s > 1.0):
            words = "; ".join(part.name for part in reading.task.subtasks)
            print(
                f"{kind or 'NO FIX'} in {took_s:.2f} s, {plan.author} {plan.name}: {words}\n  goal {reading.task.goal}"
            )
            print(f"  {len(report.errors)} errors: {first.message.splitlines()[0]}")
    refuted = len(times_s)
    print(f"outside {dict(outside)}, verdicts {dict(verdicts)}, agree {agreed} of {verdicts.total()}")
    print(f"refuted at {dict(stops)}, first error there {leading} of {refuted}, fixes by kind {dict(kinds)}")
    if refuted:
        rate, ordered = Rate(refuted - kinds["none"], refuted), sorted(times_s)
        print(f"fixed {rate.counted('refuted plans get a fix that proves')}")
        print(
            f"CPU s a plan: median {ordered[refuted // 2]:.3f}, 95 % {ordered[int(0.95 * (refuted - 1))]:.3f}, most "
            f"{ordered[-1]:.3f}, {sum(took_s > 1.0 for took_s in times_s)} over 1"
        )


if __name__ == "__main__":
    main()
