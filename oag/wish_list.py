"""What can be done in a scene: every wish that it admits, each with a goal, a sentence, and a proved plan.

    for found in oag.tasks(scene):
        print(found.wish.kind, found.sentence, found.task)

A wish is drawn from the objects and what they are for: doors open and close, the hand takes items, furniture and
vessels receive them, one by one, all of a kind, or all of a place. Its goal is that of the wish alone: a door that a
putting needs open is closed again. `wishes` lists them before anything is proved.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import bddl
from oag.model.scene import Scene
from oag.model.symbols import GRIPPER, Kind, carries_things, holding, takes_things
from oag.planning import NoPlan, plan
from oag.primitives.state import start_state
from oag.sizes import TO_THE_AIM, Gripper, Sizing, has_finger_room
from oag.task_definition import Task, required_scene
from oag.verify.verify import Verdict, verify

WishKind = Literal[
    "open", "close", "pick", "take-out", "put-into", "put-onto", "fill", "stack", "all", "empty",
    "switch-on", "switch-off", "stand-up",
]  # fmt: skip
"""`pick` takes what stands on something, `take-out` what is inside something; `put-into` and `put-onto` put one item
at furniture, `fill` into an item, `stack` onto an item; `all` puts all items of a category at furniture, and `empty`
all that is in or on a thing at other furniture. What has a button or a knob is switched on and off, and
what has fallen over is stood up."""
KINDS: tuple[WishKind, ...] = get_args(WishKind)
_MOST_TOGETHER = 6  # More things at once make plans of dozens of subtasks.
Relation = Literal["inside", "ontop"]
_PREPOSITION: dict[Relation, str] = {"inside": "into", "ontop": "onto"}


@dataclass(frozen=True, slots=True)
class Wish:
    """A wish about objects of a scene.

    Attributes:
        kind: What is asked for.
        targets: The objects that it is about: what opens or closes, or what is moved.
        relation, place: Whether they are put inside or on top, and of what; None where they are not put anywhere.
        goal: The goal G.
        sentences: Sentences for it, the most natural one first; the last one names every object by its id.
    """

    kind: WishKind
    targets: tuple[str, ...]
    relation: Relation | None
    place: str | None
    goal: bddl.Formula
    sentences: tuple[str, ...]

    def __str__(self) -> str:
        """Return the sentence that names every object by its id."""
        return self.sentences[-1]


@dataclass(frozen=True, slots=True)
class AdmittedTask:
    """A wish with a proved plan.

    Attributes:
        wish: The wish.
        sentence: A sentence for it; with a planner for sentences one that it reads as the wish's goal.
        task: The plan; `verify` proves it.
    """

    wish: Wish
    sentence: str
    task: Task

    def to_json(self) -> dict[str, object]:
        """Return the wish as plain data, with its plan as a task file's content."""
        return {
            "kind": self.wish.kind,
            "targets": list(self.wish.targets),
            "relation": self.wish.relation,
            "place": self.wish.place,
            "sentence": self.sentence,
            "goal": bddl.format(self.wish.goal),
            "subtasks": len(self.task.subtasks),
            "task": self.task.to_json(),
        }


Planner = Callable[[str], Task | None]
"""Returns the task of a sentence; None where it is not understood, or has no plan."""
OnRefusal = Callable[[Wish, NoPlan], None]


def ignore(wish: Wish, refusal: NoPlan) -> None:
    """Do nothing."""


def tasks(
    scene: Scene,
    kinds: Collection[WishKind] = KINDS,
    *,
    planner: Planner | None = None,
    sizing: Sizing = TO_THE_AIM,
    on_refusal: OnRefusal = ignore,
) -> Iterator[AdmittedTask]:
    """Yield the wishes that a scene admits, each as soon as its plan is proved.

    Args:
        scene: The scene.
        kinds: Kinds of wishes.
        planner: Plans sentences, such as `llm.tasks` does; its plan counts if its goal is equivalent to the wish's. By
            default `oag.plan` plans the goals, and the sentences are not read.
        sizing: Rule for the sizes of what the hand takes.
        on_refusal: Called with every wish that has no proved plan, and why.

    Raises:
        SceneError: The scene is no `Scene`.
    """
    required_scene(scene)
    for wish in wishes(scene, kinds, sizing=sizing):
        found = _of_goal(wish, scene, sizing) if planner is None else _of_sentence(wish, scene, planner, sizing)
        if isinstance(found, NoPlan):
            on_refusal(wish, found)
        else:
            yield found


def _of_goal(wish: Wish, scene: Scene, sizing: Sizing) -> AdmittedTask | NoPlan:
    planned = plan(scene, wish.goal, name=str(wish).replace(" ", "_"), sizing=sizing)
    if planned.task is None:
        return planned.refusal or NoPlan("no-plan", "none was found")
    return AdmittedTask(wish, wish.sentences[0], planned.task)


def _of_sentence(wish: Wish, scene: Scene, planner: Planner, sizing: Sizing) -> AdmittedTask | NoPlan:
    for sentence in wish.sentences:
        task = planner(sentence)
        if (
            task is not None
            and bddl.equivalent(task.goal, wish.goal, scene.categories)
            and verify(task, scene).verdict is Verdict.PROVED
        ):
            return AdmittedTask(wish, sentence, task)
    planned = _of_goal(wish, scene, sizing)
    if isinstance(planned, NoPlan):
        return planned
    return NoPlan("no-plan", f'a goal that can be planned, but no sentence such as "{wish}" is read as that')


def wishes(scene: Scene, kinds: Collection[WishKind] = KINDS, *, sizing: Sizing = TO_THE_AIM) -> Iterator[Wish]:
    """Yield the wishes that the objects of a scene suggest, by kind; none is fulfilled, and not all have a plan.

    Args:
        scene: The scene.
        kinds: Kinds of wishes.
        sizing: Rule for the sizes of what is put into a vessel.
    """
    listing = _Listing(scene, sizing)
    for kind in KINDS:
        if kind in kinds:
            yield from listing.of_kind(kind)


class _Listing:
    """The wishes of one scene, with what they share."""

    def __init__(self, scene: Scene, sizing: Sizing) -> None:
        self.scene, self.sizing, self.start = scene, sizing, start_state(scene, None)
        objects = scene.objects
        self.items = tuple(key for key, thing in objects.items() if thing.kind is Kind.ITEM)
        self.doors = tuple(key for key, thing in objects.items() if thing.kind is Kind.ARTICULATED)
        self.hosts: dict[str, list[tuple[Relation, str]]] = {}
        for fact, entry in self.start.entries():
            for relation in _PREPOSITION:
                if fact[0] == relation and entry.value is True and fact[2] in objects:
                    self.hosts.setdefault(fact[1], []).append((relation, fact[2]))
        self.stems = Counter(map(_stem, objects))

    def of_kind(self, kind: WishKind) -> Iterator[Wish]:
        """Yield the wishes of a kind."""
        if kind in ("open", "close"):
            yield from self._doors(kind)
        elif kind in ("pick", "take-out"):
            yield from self._picks(kind)
        elif kind == "all":
            yield from self._kinds()
        elif kind == "empty":
            yield from self._places_emptied()
        elif kind in ("switch-on", "switch-off"):
            yield from self._switchings(kind)
        elif kind == "stand-up":
            yield from self._standings()
        else:
            yield from self._placings(kind)

    def _doors(self, kind: Literal["open", "close"]) -> Iterator[Wish]:
        wanted = kind == "open"
        for door in self.doors:
            atom = bddl.Atom("open", (door,))
            if self.start.value(("open", door)) is not wanted:
                yield self._wish(kind, (door,), (atom if wanted else bddl.Not(atom),), f"{kind} {{0}}")

    def _switchings(self, kind: Literal["switch-on", "switch-off"]) -> Iterator[Wish]:
        wanted = kind == "switch-on"
        for key in self.scene.objects:
            if self.start.value(("toggled_on", key)) is (not wanted) and self._has_control(key):
                atom = bddl.Atom("toggled_on", (key,))
                goal = (atom if wanted else bddl.Not(atom),)
                yield self._wish(kind, (key,), goal, f"{kind.replace('-', ' ')} {{0}}")

    def _standings(self) -> Iterator[Wish]:
        for item in self.items:
            lies = self.start.value(("can_stand", item)) is True and self.start.value(("upright", item)) is False
            if lies and (hosts := self.hosts.get(item)):
                goal = (bddl.Atom(hosts[0][0], (item, hosts[0][1])), bddl.Atom("upright", (item,)))
                yield self._wish("stand-up", (item,), goal, "stand up {0}")

    def _has_control(self, key: str) -> bool:
        return any(self.start.value((predicate, key)) is True for predicate in ("has_button", "has_knob"))

    def _picks(self, kind: Literal["pick", "take-out"]) -> Iterator[Wish]:
        for item in self.items:
            inside = next((place for relation, place in self.hosts.get(item, ()) if relation == "inside"), None)
            if (inside is not None) is not (kind == "take-out") or self.start.hand == holding(item):
                continue
            goal = (bddl.Atom("inside", (item, GRIPPER)),)
            if inside is None:
                yield self._wish(kind, (item,), goal, "pick up {0}")
            else:
                yield self._wish(kind, (item,), goal, f"take {{0}} out of {self._called(inside)}", "pick up {0}")

    def _placings(self, kind: WishKind) -> Iterator[Wish]:
        relation: Relation = "inside" if kind in ("put-into", "fill") else "ontop"
        among_items = kind in ("fill", "stack")
        places = [key for key in self._places(relation) if (key in self.items) is among_items]
        for item in self.items:
            for place in places:
                if self._can_receive(item, relation, place):
                    yield self._put(kind, (item,), relation, place, f"put {{0}} {_PREPOSITION[relation]} {{place}}")

    def _kinds(self) -> Iterator[Wish]:
        alike: dict[str, list[str]] = {}
        for item in self.items:
            alike.setdefault(self.scene.objects[item].category, []).append(item)
        for category, ids in alike.items():
            noun = category.replace("_", " ")
            plural = f"{noun}es" if noun.endswith(("s", "x", "ch", "sh")) else f"{noun}s"
            yield from self._together("all", ids, f"all {plural}", None)

    def _places_emptied(self) -> Iterator[Wish]:
        for place in self.scene.objects:
            for relation in _PREPOSITION:
                held = [item for item in self.items if (relation, place) in self.hosts.get(item, ())]
                where = f"{'in' if relation == 'inside' else 'on'} {self._called(place)}"
                yield from self._together("empty", held, f"everything {where}", place)

    def _together(self, kind: WishKind, ids: Sequence[str], spoken: str, besides: str | None) -> Iterator[Wish]:
        """Yield the wishes that put several things at one piece of furniture."""
        if not 1 < len(ids) <= _MOST_TOGETHER:
            return
        for relation in _PREPOSITION:
            for place in self._places(relation):
                if place in self.items or place == besides:
                    continue
                moved = tuple(item for item in ids if self._can_receive(item, relation, place))
                if len(moved) == len(ids):
                    yield self._put(kind, moved, relation, place, f"put {spoken} {_PREPOSITION[relation]} {{place}}")

    def _places(self, relation: Relation) -> list[str]:
        takes = takes_things if relation == "inside" else carries_things
        return [key for key, thing in self.scene.objects.items() if takes(thing.category, thing.kind)]

    def _can_receive(self, item: str, relation: Relation, place: str) -> bool:
        """Decide whether an item can be put somewhere else: not where it is, nor into what stands on it."""
        thing, vessel = self.scene.objects[item], self.scene.objects[place]
        if item == place or (relation, place) in self.hosts.get(item, ()) or item in self._around(place):
            return False
        if relation == "ontop" or vessel.kind is not Kind.ITEM:
            return True
        return has_finger_room(thing, vessel, self.sizing.factor(thing, Gripper.of(self.scene.robot)))

    def _around(self, key: str) -> list[str]:
        """Return what an object stands in or on, and so on outwards."""
        found: list[str] = []
        pending = [key]
        while pending:
            for _, host in self.hosts.get(pending.pop(), ()):
                if host not in found:
                    found.append(host)
                    pending.append(host)
        return found

    def _shut(self, key: str) -> bool:
        return key in self.doors and self.start.value(("open", key)) is not True

    def _put(self, kind: WishKind, items: tuple[str, ...], relation: Relation, place: str, spoken: str) -> Wish:
        behind = [host for item in items for host in self._enclosing(item)]
        behind += [*self._enclosing(place), *((place,) if relation == "inside" else ())]
        shut = dict.fromkeys(filter(self._shut, behind))
        goal = [bddl.Atom(relation, (item, place)) for item in items]
        closed = [bddl.Not(bddl.Atom("open", (door,))) for door in shut]
        exact = f"put {_listed(items)} {_PREPOSITION[relation]} {{place}}"
        return self._wish(kind, items, (*goal, *closed), spoken, exact, relation=relation, place=place)

    def _enclosing(self, key: str) -> Iterator[str]:
        """Yield what has to be open to get at an object, the innermost first."""
        for each in (key, *self._around(key)):
            yield from (host for relation, host in self.hosts.get(each, ()) if relation == "inside")

    def _wish(
        self,
        kind: WishKind,
        targets: tuple[str, ...],
        goal: Sequence[bddl.Formula],
        *forms: str,
        relation: Relation | None = None,
        place: str | None = None,
    ) -> Wish:
        whole = goal[0] if len(goal) == 1 else bddl.And(tuple(goal))
        named = [form.format(*map(self._called, targets), place=self._called(place or "")) for form in forms[:1]]
        exact = forms[-1].format(*targets, place=place)
        return Wish(kind, targets, relation, place, whole, tuple(dict.fromkeys((*named, exact))))

    def _called(self, key: str) -> str:
        stem = _stem(key)
        return f"the {stem.replace('_', ' ')}" if stem and self.stems[stem] == 1 else key


def _stem(key: str) -> str:
    return key.rstrip("0123456789").rstrip("_")


def _listed(ids: Sequence[str]) -> str:
    *first, last = ids
    return f"{', '.join(first)} and {last}" if first else last
