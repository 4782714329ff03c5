"""Units of a data set: one unit a demonstration, with everything that decides its outcome; and the axes that vary.

A variation differs per axis from episode to episode, beyond layout, assets, places and the robot's start. Draws follow
from the unit's origin (family or sentence), its seed and the axis alone. Switching one axis on changes no other.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, StrictBool, StrictFloat, StrictInt

from executor.campaign.planning_model import PlanningModel
from executor.campaign.versions import SURFACES_VERSION, UNORDERED_VERSION
from executor.scenes.generators.families import HOUSEHOLD, LONG_HORIZON, Family, Flows, Seed, pair_name, pairs_from
from executor.scenes.room import Draws, Perturbation
from executor.scenes.vary import LARGEST_SEED, MOST_EPISODES
from executor.sim.engine import Physics
from executor.sim.render.cameras import VIEWS
from executor.sim.robot.description import FINGER_FRICTION
from executor.system.files import content_key, json_text, plain
from oag import Scene, Task
from oag.model.forms import adapter
from oag.model.robots import FULL_SIZE, PAPER_ROBOT, chosen_robot, known_robot, robot_named


@dataclass(frozen=True, slots=True)
class Variation:
    """Axes that vary.

    Attributes:
        target: Size (by up to 0.10 either way) and heading (by up to 15 degrees) of items that are taken and of
            furniture that is opened or shut (the paper's domain randomisation). Drawn before sizes are adjusted to the
            gripper.
        surfaces: Colours and textures of furniture, walls, floor and things.
        lights: Direction, colour and strength of lights, and the room's surroundings.
        cameras: Poses and opening angles of the cameras, within the limits of their mounts.
        distractors: Maximum number of added things that are irrelevant to the task.
        physics: Mass and friction of things.
        look: Number of the look that surfaces, lights and cameras are drawn for; one motion can have several.
        noise_m: Standard deviation of the noise in hand commands [m]; recorded actions are without it.
    """

    target: StrictBool = False
    surfaces: StrictBool = False
    lights: StrictBool = False
    cameras: StrictBool = False
    distractors: Annotated[StrictInt, Field(ge=0, le=8)] = 0
    physics: StrictBool = False
    noise_m: Annotated[StrictFloat | StrictInt, Field(ge=0, le=0.05)] = 0
    look: Annotated[StrictInt, Field(ge=0, le=LARGEST_SEED)] = 0


UNVARIED = Variation()


def draw_physics(rng: np.random.Generator) -> Physics:
    """Draw physics with heavier or lighter, more or less slippery things, and stiffer or looser doors."""

    def factor(most: float) -> float:
        return float(math.exp(rng.uniform(-math.log(most), math.log(most))))

    # Wider than weights and surfaces within a household category, within the limits of a grip.
    return Physics(
        item_mass=factor(1.5),
        item_friction=factor(1.2),
        finger_friction=FINGER_FRICTION * factor(1.15),
        joint_friction=factor(1.4),
        damping=factor(1.4),
    )


def draw_perturbations(scene: Scene, task: Task, draws: Draws) -> dict[str, Perturbation]:
    """Draw how each target of a task deviates from the scene; scenes of one's own have no deviation."""
    targets = dict.fromkeys(part.target for part in task.subtasks)
    return {name: Perturbation.drawn(scene[name], draws) for name in targets}


def apply_perturbations(scene: Scene, perturbations: Mapping[str, Perturbation]) -> Scene:
    """Return the scene with perturbed targets, their bottoms unchanged."""
    others = {name: perturbation.standing(scene[name]) for name, perturbation in perturbations.items()}
    return replace(scene, objects={**scene.objects, **others})


SCHEMA = "scene2demo-demonstration/1"
MOST_STANCES = 32
View = Literal["global", "head", "wrist"]
Repair = Literal["scene"]
Pushed = Literal["base", "item"]
"""Target of pushes in the middle of an episode: the robot's base, or the task's item."""

Side = Annotated[StrictInt, Field(ge=32, le=1024, multiple_of=2)]


@dataclass(frozen=True, slots=True)
class Recording:
    """Recorded data of an episode.

    Attributes:
        rate_hz: Samples a second of simulated time.
        views: Cameras that are rendered; none by default.
        size: Width and height of the pictures.
        depth, segmentation: Whether these are rendered in addition to colours.
        failures: Whether the samples of failed episodes are kept, too; the failure itself always is.
        home: Whether pictures show a home (`executor.sim.render.home`); without, assets have their own colours.
    """

    rate_hz: Annotated[StrictFloat | StrictInt, Field(ge=1, le=250)] = 10
    views: tuple[View, ...] = ()
    size: tuple[Side, Side] = (128, 128)
    depth: StrictBool = True
    segmentation: StrictBool = True
    failures: StrictBool = False
    home: StrictBool = False

    def __post_init__(self) -> None:
        if len(set(self.views)) != len(self.views):
            raise ValueError(f"a view is named twice; the views are {', '.join(VIEWS)}")


@dataclass(frozen=True, slots=True)
class Origin:
    """Origin of scene and task: a benchmark family, or a sentence in a scene.

    Attributes:
        family: "T1" to "T6", or None for a sentence.
        query: The sentence; empty for a family, which has its own.
        scene: Name of a scene, or its file; empty for a family, which draws its own.
        scene_key: Key of the scene's content, so that another content makes another unit; empty where seeds draw it.
    """

    family: Family | None = None
    query: str = ""
    scene: str = ""
    scene_key: str = ""

    def __post_init__(self) -> None:
        if (self.family is None) is not bool(self.query and self.scene):
            raise ValueError("a source is a family, or a query and a scene")

    @property
    def label(self) -> str:
        """Short name that is valid in file names."""
        return self.family or re.sub(r"[^a-z0-9]+", "-", self.query.casefold()).strip("-")[:40]


def scene_key(scene: Scene) -> str:
    """Return the key of a scene's content."""
    return content_key(json_text(scene.to_json()))


@dataclass(frozen=True, slots=True)
class Takeover:
    """Policy that acts before the planner: from the episode's start until it restarts or stalls.

    Attributes:
        policy: Key of its record and weights.
        execute: Executed actions per predicted chunk.
        pushes: What is pushed once during its episode, at a time and in a direction that the unit's seed draws.
    """

    policy: str
    execute: Annotated[StrictInt, Field(ge=1, le=64)]
    pushes: tuple[Pushed, ...] = ()


@dataclass(frozen=True, slots=True)
class DemoUnit:
    """One demonstration to generate.

    Attributes:
        origin: Origin of scene and task.
        seed: Seed of the layout, of variations and of all planning; for T5 and T6 of the set of pairs.
        index: Position of the pair in its set; None unless the family is T5 or T6.
        variation: Further variation.
        recording: Recorded data.
        evolve: Whether flows that fail are revised; failed attempts and corrections are kept as episodes of their own.
        flows: The offline planner's flows, or the paper's, numbers verbatim.
        keep_sizes: Whether handled things keep their sizes.
        full_size: Whether the robot is of full size, whatever the scene's robot.
        stances: Number of stances planned at each choice (`Session.stances`), so that the choice follows from
            observable state. 1 takes the one that the unit's seed gives.
        takeover: Policy that acted before the planner; None for an episode from its start.
        robot: Name of the robot; empty for a family's, the paper's, and for a scene's own that keeps the order of its
            searches. `full_size` is another word for the Panda of full size.
        repair: "scene" where the scene is changed so that the task can be done (`executor.rollouts.scene_repairs`).
        model: Language model that plans the unit; None for the offline planner.
    """

    origin: Origin
    seed: Seed
    index: Annotated[StrictInt, Field(ge=0)] | None = None
    variation: Variation = field(default_factory=Variation)
    recording: Recording = field(default_factory=Recording)
    evolve: StrictBool = False
    flows: Flows = "planned"
    keep_sizes: StrictBool = False
    full_size: StrictBool = False
    stances: Annotated[StrictInt, Field(ge=1, le=MOST_STANCES)] = 1
    takeover: Takeover | None = None
    robot: Annotated[str, AfterValidator(known_robot)] = ""
    repair: Repair | None = None
    model: PlanningModel | None = None

    def __post_init__(self) -> None:
        if self.robot == FULL_SIZE.name:
            # One request has one id, however it was worded.
            object.__setattr__(self, "full_size", True)
            object.__setattr__(self, "robot", "")
        if self.robot == PAPER_ROBOT.name and self.origin.family is not None:
            object.__setattr__(self, "robot", "")
        if self.robot and self.full_size:
            raise ValueError(f"the robot {self.robot} is not the Panda of full size; keep one of them")
        if self.takeover is not None and (self.evolve or self.flows == "paper"):
            raise ValueError("a plan that goes on from where a policy came to is the planner's, and no flow is revised")
        if self.repair is not None and (self.evolve or self.takeover is not None or self.flows == "paper"):
            raise ValueError("a scene is repaired for the planner's own plan, which is not revised")
        placed = self.origin.family is None and bool(self.variation.target or self.variation.distractors)
        if self.model is not None:
            self._check_planned_by_model(placed=placed)
        if self.repair is not None and placed:
            raise ValueError(
                "where a scene is repaired for a sentence, neither its target varies nor are distractors added: both "
                "need a plan before the repair; leave out --repair, or --vary target and --distractors"
            )
        if (self.index is None) is not (self.origin.family not in HOUSEHOLD):
            raise ValueError(f"{self.origin.label} has no unit {self.index}")
        if self.flows == "paper" and self.origin.family not in LONG_HORIZON:
            raise ValueError(f"the paper prints no flows for {self.origin.label}")

    def _check_planned_by_model(self, *, placed: bool) -> None:
        """Refuse what needs the offline planner as well."""
        if self.repair is not None or self.takeover is not None or self.flows == "paper":
            raise ValueError(
                "a model plans a scene as it is: leave out --model, or what repairs the scene, goes on after a policy, "
                "or takes the paper's flows"
            )
        if placed:
            raise ValueError(
                "where a model plans a sentence, neither its target varies nor are distractors added: both need a plan "
                "before; leave out --model, or --vary target and --distractors"
            )

    @property
    def robot_name(self) -> str:
        """Name of the chosen robot; empty where none is."""
        return chosen_robot(self.robot, full_size=self.full_size)

    @property
    def name(self) -> str:
        """Human-readable name."""
        return f"{self.origin.label}-{pair_name(self.seed, self.index)}"

    def id(self, version: str) -> str:
        """Return a key that is equal when all inputs of the unit's outcome are, its recording included.

        Args:
            version: Hash of the program (`executor.campaign.versions.outcome_version`).
        """
        return next(self.equal_ids(version))

    def equal_ids(self, version: str) -> Iterator[str]:
        """Yield the unit's id, then those that earlier programs gave a unit of the same outcome.

        Earlier programs had a family's own robot by its name.

        Args:
            version: Hash of the program.
        """
        return self._ids_under(self._full_version(version))

    def ids(self, version: str) -> Iterator[str]:
        """Yield all ids that a program of this version may have given the unit, those of `equal_ids` first.

        Outcomes under the others may differ by now: programs had earlier versions, or none, for robots that keep no
        order, and none for pictures of varied surfaces.

        Args:
            version: Hash of the program.
        """
        yield from self.equal_ids(version)
        earlier = [version]
        if not self._keeps_order:
            earlier += [f"{version} unordered {number}" for number in range(1, UNORDERED_VERSION + 1)]
        for full_version in earlier:
            yield from self._ids_under(full_version)

    def _ids_under(self, full_version: str) -> Iterator[str]:
        data = self.to_json()
        if self.origin.scene_key:
            data["origin"]["scene"] = ""  # The content identifies the scene, wherever its file lies.
        yield _id_of(data, full_version)
        if self.origin.family and not self.robot_name:
            yield _id_of(data | {"robot": PAPER_ROBOT.name}, full_version)

    @property
    def _keeps_order(self) -> bool:
        return robot_named(self.robot_name or PAPER_ROBOT.name).keeps_order

    @property
    def _varies_plain_looks(self) -> bool:
        return bool(self.recording.views) and self.variation.surfaces and not self.recording.home

    def _full_version(self, version: str) -> str:
        version = version if self._keeps_order else f"{version} unordered {UNORDERED_VERSION}"
        return f"{version} surfaces {SURFACES_VERSION}" if self._varies_plain_looks else version

    def folder(self, version: str) -> str:
        """Return the name of the unit's folder: its own name, and the begin of its id."""
        return self.folder_of(self.id(version))

    def folder_of(self, unit_id: str) -> str:
        """Return the name of the unit's folder under one of its ids."""
        return f"{self.name}-{unit_id[:8]}"

    def draws(self, axis: str) -> np.random.Generator:
        """Return the random generator of an axis; it follows from origin, seed, index and axis alone."""
        of = f"{self.origin.label} {axis}".encode()
        return np.random.default_rng((self.seed, 0 if self.index is None else self.index + 1, *of))

    def looks(self, axis: str) -> np.random.Generator:
        """Return the random generator of the unit's look on an axis."""
        return self.draws(f"{axis} {self.variation.look}" if self.variation.look else axis)

    def to_json(self) -> dict[str, Any]:
        """Return the unit as plain data, with equal text for equal units, however their numbers were typed.

        Omits fields at their defaults that earlier programs did not have, so that old ids stay valid.
        """
        data: dict[str, Any] = plain(asdict(self))
        data["recording"]["rate_hz"] = _canonical_number(data["recording"]["rate_hz"])
        data["recording"]["views"].sort(key=VIEWS.index)
        data["variation"]["noise_m"] = _canonical_number(data["variation"]["noise_m"])
        if not self.recording.home:
            del data["recording"]["home"]
        if not self.variation.look:
            del data["variation"]["look"]
        if self.stances == 1:
            del data["stances"]
        if self.takeover is None:
            del data["takeover"]
        elif not self.takeover.pushes:
            del data["takeover"]["pushes"]
        for name in ("robot", "repair", "model"):
            if not data[name]:
                del data[name]
        return data

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> DemoUnit:
        """Parse the unit that `to_json` returned.

        Raises:
            ValueError: It is no such data.
        """
        return adapter(cls).validate_python(value)


def _id_of(data: Mapping[str, Any], version: str) -> str:
    return content_key(SCHEMA, version, json_text(data))


def _canonical_number(value: float) -> float:
    """Normalise a number: 10, 10.0 and 1e1 alike, and no signed zero; a bool stays one."""
    return value if isinstance(value, bool) else float(value) + 0.0


@dataclass(frozen=True, slots=True)
class DemoSeries:
    """Units of one origin with consecutive seeds.

    Attributes:
        first: Unit of the first seed.
        episodes: Number of units.
        successes: Successes after which no further unit is begun; None where all units are wanted.
    """

    first: DemoUnit
    episodes: Annotated[StrictInt, Field(ge=0, le=MOST_EPISODES)]
    successes: Annotated[StrictInt, Field(ge=1, le=MOST_EPISODES)] | None = None

    def units(self) -> Iterator[DemoUnit]:
        """Yield the units in order; those of T5 and T6 go through one set of pairs after the other."""
        for seed, index in pairs_from(self.first.origin.family, self.first.seed, self.episodes):
            yield replace(self.first, seed=seed, index=index)

    def to_json(self) -> dict[str, Any]:
        """Return the series as plain data."""
        more = {} if self.successes is None else {"successes": self.successes}
        return {"first": self.first.to_json(), "episodes": self.episodes, **more}

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> DemoSeries:
        """Parse the series that `to_json` returned.

        Raises:
            ValueError: It is no such data.
        """
        return adapter(cls).validate_python(value)
