"""Changes of a query and its scene after which the same decomposition is right, each drawn from a seeded generator.

"paraphrase" says the query otherwise, "rename" gives objects other numbers, "order" lists objects and facts in another
order, "distractors" adds items that nobody speaks of, and "mirror" exchanges left and right of the robot.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from random import Random
from typing import Literal, get_args

import bddl
from oag.model.codec import did_you_mean
from oag.model.diagnostics import TaskError
from oag.model.scene import FLOOR, NO_BOX, Quaternion, RobotPose, Scene, SceneObject
from oag.model.symbols import Kind
from oag.rewriting import rename_objects

Perturbation = Literal["paraphrase", "rename", "order", "distractors", "mirror"]
PERTURBATIONS: tuple[Perturbation, ...] = get_args(Perturbation)
# Small things that stand about in homes.
_DISTRACTORS = ("sponge", "book", "pen", "phone", "remote", "ball", "block", "jar", "lid", "jug", "toy", "candle")
_DISTRACTOR_M = (0.05, 0.05, 0.08)
_MOST_DISTRACTORS = 3
# Of a thing that stands on nothing: away from everything that a scene may have [m].
_ELSEWHERE_M = 50.0
_NUMBER = re.compile(r"_?(\d+)\Z")
_MARK = "\N{REPLACEMENT CHARACTER}"
_SIDES = {"left": "right", "right": "left"}


@dataclass(frozen=True, slots=True)
class Setting:
    """A query in a scene, with some changes.

    Attributes:
        kinds: What was changed, in the order of `PERTURBATIONS`.
        original: Id in the changed scene -> id in the given one; of distractors their own.
        judged: The given scene with the distractors, under the given names: plans are compared there.
    """

    query: str
    scene: Scene
    kinds: tuple[Perturbation, ...]
    original: Mapping[str, str]
    judged: Scene

    def __repr__(self) -> str:
        return f"<Setting {' '.join(self.kinds) or 'as given'}: {self.query[:100]!r}>"


def checked(kinds: Iterable[str]) -> tuple[Perturbation, ...]:
    """Return kinds of changes, each once and in order; raises TaskError for another name."""
    given = (kinds,) if isinstance(kinds, str) else tuple(kinds)
    for kind in given:
        if kind not in PERTURBATIONS:
            hint = did_you_mean(str(kind), PERTURBATIONS, f"there are {', '.join(PERTURBATIONS)}")
            raise TaskError(f"there is no change {kind!r}", source="(argument)", place="perturb", hint=hint)
    return tuple(kind for kind in PERTURBATIONS if kind in given)


def perturbed(
    query: str, scene: Scene, kinds: Collection[Perturbation], rng: Random, wordings: Sequence[str]
) -> Setting:
    """Return a query in its scene, with some changes; wordings are other sentences for the query."""
    names = {key: key for key in scene.objects}
    changed = judged = scene
    if "paraphrase" in kinds and wordings:
        query = rng.choice(wordings)
    if "distractors" in kinds:
        judged = changed = with_distractors(scene, query, rng)
    if "mirror" in kinds:
        changed, query = mirrored(changed), re.sub(r"\b(left|right)\b", _other_side, query, flags=re.IGNORECASE)
    if "rename" in kinds:
        names = new_names(changed, rng)
        changed, query = renamed(changed, names), _renamed_query(query, names)
    if "order" in kinds:
        changed = reordered(changed, rng)
    original = {key: key for key in changed.objects} | {new: old for old, new in names.items()}
    return Setting(query, changed, tuple(kind for kind in PERTURBATIONS if kind in kinds), original, judged)


def _other_side(match: re.Match[str]) -> str:
    word = _SIDES[match[0].lower()]
    return word.capitalize() if match[0][0].isupper() else word


def new_names(scene: Scene, rng: Random) -> dict[str, str]:
    """Return another id for each object but the floor, with the same noun and a number that no id has."""
    taken = {match[1] for key in scene.objects if (match := _NUMBER.search(key))}
    free = [str(number) for number in range(10, 99 + 2 * len(scene.objects)) if str(number) not in taken]
    numbers = iter(rng.sample(free, len(scene.objects)))
    return {key: key if key == FLOOR else f"{_NUMBER.sub('', key)}_{next(numbers)}" for key in scene.objects}


def renamed(scene: Scene, names: Mapping[str, str]) -> Scene:
    """Return a scene with its objects under other ids."""
    objects = {names[key]: replace(thing, id=names[key]) for key, thing in scene.objects.items()}
    facts = tuple(rename_objects(fact, lambda name: names.get(name, name)) for fact in scene.facts)
    return replace(scene, objects=objects, facts=facts, variation={})


def _renamed_query(query: str, names: Mapping[str, str]) -> str:
    """Return a query whose ids, also written as "glass 0", are the new ones."""
    for key, new in sorted(names.items(), key=lambda pair: -len(pair[0])):
        if match := _NUMBER.search(key):
            stem = r"[\s_-]".join(map(re.escape, key[: match.start()].split("_")))
            pattern = rf"(?<![\w-])({stem})([\s_-]?){match[1]}(?![\w])"
            # The mark keeps a new number from being read as an old one.
            query = re.sub(pattern, rf"\1\2{_MARK}{new.rsplit('_', 1)[1]}", query)
    return query.replace(_MARK, "")


def reordered(scene: Scene, rng: Random) -> Scene:
    """Return a scene that lists its objects and facts in another order."""
    keys, facts = list(scene.objects), list(scene.facts)
    rng.shuffle(keys)
    rng.shuffle(facts)
    return replace(scene, objects={key: scene.objects[key] for key in keys}, facts=tuple(facts))


def with_distractors(scene: Scene, query: str, rng: Random) -> Scene:
    """Return a scene with one to three items more, of categories that neither the scene nor the query names.

    They stand on furniture that the query does not name, else on nothing. A query about everything means them too.
    """
    spoken = {word.removesuffix("s") for word in re.findall(r"[a-z]+", query.lower())}
    present = {word for thing in scene.objects.values() for word in thing.category.lower().split("_")}
    free = [noun for noun in _DISTRACTORS if noun not in spoken and noun not in present]
    supports = [
        thing
        for thing in scene.objects.values()
        if thing.kind is Kind.SUPPORT and spoken.isdisjoint(thing.category.lower().split("_"))
    ]
    objects, facts = dict(scene.objects), list(scene.facts)
    for noun in rng.sample(free, min(len(free), rng.randint(1, _MOST_DISTRACTORS))):
        key = next(name for name in (f"{noun}_{number}" for number in range(len(objects) + 1)) if name not in objects)
        support = rng.choice(supports) if supports else None
        objects[key] = _distractor(key, noun, support, scene, rng)
        if support is not None:
            facts.append(bddl.Atom("ontop", (key, support.id)))
    return replace(scene, objects=objects, facts=tuple(facts))


def _distractor(key: str, noun: str, support: SceneObject | None, scene: Scene, rng: Random) -> SceneObject:
    upright = (1.0, 0.0, 0.0, 0.0)
    if not any(thing.has_box for thing in scene.objects.values()):
        return SceneObject(key, noun, noun, (0.0, 0.0, 0.0), upright, NO_BOX)
    half_m = _DISTRACTOR_M[2] / 2
    place = (_ELSEWHERE_M, rng.uniform(-_ELSEWHERE_M, _ELSEWHERE_M), half_m)
    if support is not None:
        x, y, z = support.position
        place = (x, y, z + support.height_m / 2 + half_m)
    return SceneObject(key, noun, noun, place, upright, _DISTRACTOR_M)


def mirrored(scene: Scene) -> Scene:
    """Return a scene with left and right of the robot exchanged: every box reflected at the plane that it faces along.

    A part of an object that is named as left or right, such as a hinge, changes sides with it.
    """
    objects = {key: _mirrored(thing, scene.robot) for key, thing in scene.objects.items()}
    return replace(scene, objects=objects, variation={})


def _mirrored(thing: SceneObject, robot: RobotPose) -> SceneObject:
    cos, sin = math.cos(robot.yaw_rad), math.sin(robot.yaw_rad)
    x, y = thing.position[0] - robot.position[0], thing.position[1] - robot.position[1]
    ahead, left = cos * x + sin * y, cos * y - sin * x
    place = (
        robot.position[0] + cos * ahead + sin * left,
        robot.position[1] + sin * ahead - cos * left,
        thing.position[2],
    )
    facing: Quaternion = (math.cos(robot.yaw_rad / 2), 0.0, 0.0, math.sin(robot.yaw_rad / 2))
    w, i, j, k = _product((facing[0], 0.0, 0.0, -facing[3]), thing.orientation)
    sides = {
        name: _SIDES.get(value, value) if isinstance(value, str) else value for name, value in thing.parameters.items()
    }
    return replace(thing, position=place, orientation=_product(facing, (w, -i, j, -k)), parameters=sides)


def _product(first: Quaternion, second: Quaternion) -> Quaternion:
    """Return the product of two quaternions w x y z."""
    a, b, c, d = first
    w, x, y, z = second
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )
