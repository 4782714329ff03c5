"""Questions that planning asks about a scene: what can be done with things, where they stand, what is shut or held."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import bddl
from llm.offline.wish import RELATIONS, Intent, IntentKind, Relation
from oag import Scene, SceneObject
from oag.model.facts import GRIPPER
from oag.task.sizes import TO_THE_AIM, Sizing

# What closes an opening.
Front = Literal["door", "drawer"]
FRONTS: tuple[Front, ...] = get_args(Front)


@dataclass(frozen=True, slots=True)
class Affordances:
    """What can be done with an object.

    Attributes:
        interior: Things can be put inside.
        surface: Things can be put on top.
        door: It can be opened and closed.
        fronts: By what it is opened, as far as that is known; empty where nothing says so.
    """

    interior: bool = False
    surface: bool = False
    door: bool = False
    fronts: frozenset[Front] = frozenset()

    def opens_by(self, front: Front) -> bool:
        """Whether opening it can be called opening a door, or a drawer.

        A plan opens a thing as a whole. What has both is opened by its doors, which close its larger compartments; what
        is not known to have a drawer has none.
        """
        return self.door and (self.fronts == {"drawer"}) is (front == "drawer")


def affordances(thing: SceneObject, listed: Affordances | None, facts: Mapping[bddl.Atom, bool]) -> Affordances:
    """Returns what can be done with an object: what its category says, and what the scene's facts show beside it.

    Args:
        thing: The object.
        listed: What a lexicon says of its category, or None when it has no entry. Then a fixture (type A) counts as
            one with a door and an item (type B) as neither container nor support.
        facts: Stated atoms. Where something is inside an object it has an interior, whatever its category; a fixture
            that is said to be open or not has one behind its door, such as a nightstand with a drawer.

    Returns:
        The affordances. Doors and drawers are known from the lexicon, and from the words of the category and of the
        model, such as `cabinet_two_doors`.
    """
    is_fixture = thing.role == "A"
    base = listed or Affordances(interior=is_fixture, door=is_fixture)
    stated = ((atom, value) for atom, value in facts.items() if atom.args[-1] == thing.id)
    shown = {atom.predicate for atom, value in stated if value or atom.predicate == "open"}
    return Affordances(
        interior=base.interior or "inside" in shown or ("open" in shown and is_fixture),
        surface=base.surface or "ontop" in shown,
        door=base.door or "open" in shown,
        fronts=base.fronts | fronts_in(thing.category) | fronts_in(thing.model.rsplit("/", 1)[-1]),
    )


def fronts_in(name: str) -> frozenset[Front]:
    """Returns the doors and drawers that a category or the name of a model speaks of."""
    words = set(re.split(r"[^a-z]+", name.lower()))
    return frozenset(front for front in FRONTS if words & {front, f"{front}s"})


@dataclass(frozen=True, slots=True)
class Support:
    """Where an object stands: `relation` to `object_id` (which may be the gripper)."""

    relation: Relation
    object_id: str

    def __str__(self) -> str:
        return f"{'in' if self.relation == 'inside' else 'on'} {self.object_id}"


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The facts of a scene, ready to be asked.

    Attributes:
        scene: The scene.
        known: Every stated atom with its value.
        affordances: What can be done with each object, by id.
        standing: What each object is known to stand in or on, insides first: asked so often that it is kept by object.
        sizing: What becomes of sizes.
    """

    scene: Scene
    known: Mapping[bddl.Atom, bool]
    affordances: Mapping[str, Affordances]
    standing: Mapping[str, tuple[Support, ...]] = field(repr=False)
    sizing: Sizing = TO_THE_AIM

    @classmethod
    def of(cls, scene: Scene, listed: Mapping[str, Affordances]) -> Surroundings:
        """Returns the surroundings of a scene, from its facts; `listed` says what categories are known to afford."""
        stated = (bddl.literals(fact) or () for fact in scene.facts)
        known = {literal.atom: literal.value for literals in stated for literal in literals}
        can = {key: affordances(thing, listed.get(thing.category), known) for key, thing in scene.objects.items()}
        return cls(scene, known, can, _standing(known))

    def value(self, atom: bddl.Atom) -> bool | None:
        """Decides an atom at the start: True, False, or None where the scene does not say.

        Source: open world, except for the predicates that the scene declares closed.
        """
        known = self.known.get(atom)
        return False if known is None and atom.predicate in self.scene.closed else known

    def is_open(self, object_id: str) -> bool | None:
        """Decides whether an object is open at the start; None where the scene does not say."""
        return self.value(bddl.Atom("open", (object_id,)))

    def supports(self, object_id: str) -> tuple[Support, ...]:
        """Returns what the object is stated to stand in or on, insides first."""
        return self.standing.get(object_id, ())

    def support(self, object_id: str) -> Support | None:
        """Returns the nearest thing that the object stands in or on; None where the scene does not say."""
        return next(iter(self.supports(object_id)), None)

    def chain(self, object_id: str) -> tuple[Support, ...]:
        """Returns where the object stands, where that stands, and so on outwards."""
        found: list[Support] = []
        seen = {object_id}
        step = self.support(object_id)
        while step is not None and step.object_id not in seen:
            found.append(step)
            seen.add(step.object_id)
            step = self.support(step.object_id)
        return tuple(found)

    def is_shut(self, object_id: str) -> bool:
        """Decides whether an object has a door that is not known to be open.

        A container that the scene does not say to be open or closed counts as closed: opening it is then part of the
        plan, and `verify` lists the assumption.
        """
        return object_id in self.affordances and self.affordances[object_id].door and not self.is_open(object_id)

    def doors_in_the_way(self, intent: Intent) -> tuple[str, ...]:
        """Returns the closed containers that have to be opened before an item can be taken or put where it is wanted.

        The order is that of opening: a container around another one comes first, and those around the item come before
        those around its destination. For opening and closing nothing is in the way.
        """
        if intent.kind.is_about_a_door:
            return ()
        around = [self.chain(intent.target), () if intent.destination is None else self.chain(intent.destination)]
        doors = [step.object_id for chain in around for step in reversed(chain) if step.relation == "inside"]
        if intent.destination is not None and intent.relation == "inside":
            doors.append(intent.destination)
        return tuple(dict.fromkeys(filter(self.is_shut, doors)))

    def fulfils(self, intent: Intent) -> bool:
        """Decides whether a wish is known to be fulfilled as things are."""
        return all(self.value(literal.atom) is literal.value for literal in bddl.literals(intent.wish) or ())

    def after(self, intent: Intent) -> Surroundings:
        """Returns the surroundings once a wish is fulfilled; doors on its way are as they were.

        What stands in or on a thing moves along with it.
        """
        if intent.kind.is_about_a_door:
            return self.with_doors((intent.target,), intent.kind is IntentKind.OPEN)
        known = dict(self.known)
        for support in self.supports(intent.target):
            known[bddl.Atom(support.relation, (intent.target, support.object_id))] = False
        wish = {literal.atom: literal.value for literal in bddl.literals(intent.wish) or ()}
        return replace(self, known=known | wish, standing={**self.standing, **_standing(wish)})

    def with_doors(self, doors: Iterable[str], is_open: bool) -> Surroundings:
        """Returns the surroundings with some doors open, or closed."""
        return replace(self, known={**self.known, **{bddl.Atom("open", (door,)): is_open for door in doors}})

    def held(self) -> tuple[str, ...]:
        """Returns the ids of what the hand holds."""
        return self.cargo(GRIPPER)

    def cargo(self, object_id: str) -> tuple[str, ...]:
        """Returns what stands in or on the object, and so moves along with it."""
        return tuple(key for key in self.scene.objects if any(s.object_id == object_id for s in self.supports(key)))

    def described(self, object_id: str) -> str:
        """Returns an object with its category, place and state, such as "glass_0 (water_glass) on table_0"."""
        category = self.scene.objects[object_id].category
        text = object_id if object_id.rsplit("_", 1)[0] == category else f"{object_id} ({category})"
        support = self.support(object_id)
        if support is not None:
            text += f" {support}"
        state = self.known.get(bddl.Atom("open", (object_id,)))
        return text if state is None else f"{text}, {'open' if state else 'closed'}"

    def bearing(self, object_id: str) -> str:
        """Returns where an object is, seen from the robot's start, such as "1.2 m ahead of the robot, on its left"."""
        robot, place = self.scene.robot, self.scene.objects[object_id].position
        dx, dy = place[0] - robot.position[0], place[1] - robot.position[1]
        angle = math.atan2(dy, dx) - robot.yaw_rad
        forward, left = math.cos(angle), math.sin(angle)
        main = "ahead of" if forward > 0 else "behind"
        side = "" if abs(left) < 0.26 else f", on its {'left' if left > 0 else 'right'}"  # 15 degrees
        return f"{math.hypot(dx, dy):.1f} m {main} the robot{side}"


def _standing(known: Mapping[bddl.Atom, bool]) -> dict[str, tuple[Support, ...]]:
    """Returns what each object is known to stand in or on, insides first."""
    found: dict[str, tuple[Support, ...]] = {}
    for relation in RELATIONS:
        for atom, value in known.items():
            if value and atom.predicate == relation:
                found[atom.args[0]] = (*found.get(atom.args[0], ()), Support(relation, atom.args[1]))
    return found
