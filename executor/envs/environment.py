"""The environment: Gymnasium's interface to an episode's physics."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, SupportsFloat

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from executor.bench.units import Family
from executor.datasets.formats.clouds import POINTS, CloudReader
from executor.datasets.formats.observations import AGENT, ENVIRONMENT, LARGEST, StateReader, named
from executor.datasets.variation import UNVARIED, Variation
from executor.envs.elbow import Elbow
from executor.envs.episodes import DrawnEpisode, Source, of_family, of_query, of_task
from executor.envs.following import HandFollower
from executor.envs.progress import Progress, ProgressWatch
from executor.envs.simulation import FOLLOWING_SPEEDS, SPEEDS, Simulation, steps_each
from executor.envs.views import Views
from executor.geometry import Array
from executor.pictures.cameras import VIEWS
from executor.pictures.frames import Picture
from executor.pictures.render import check_size
from executor.robot.actions import HAND_NUMBERS, joint_limits
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.continuing import checkpoint_of
from executor.scenes.pair import NotDrawn
from executor.scenes.vary import LARGEST_SEED, check_seed
from executor.world.engine import TIMESTEP_S
from executor.world.physics import STANDARD, Physics
from executor.world.world import World
from oag import Scene, Task
from oag.model.scenefile import FULL_SCALE, PAPER_SCALE

Observation = dict[str, Any]
ActionMode = Literal["joint_target", "paper"]
ObservationMode = Literal["state", "point_cloud", "pixels"]

_HAND_SPEED_M_S, _HAND_TURN_RAD_S = 1.2, 4.0  # Several joints at their limits together.
_DRAWS = 5  # Seeds of one's own that are tried where no room can be made of one.


class SceneEnvironment(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A mobile robot in a room, with something to do; docs/environment.md says what it is told and what it may do.

    Args:
        family: "T1" to "T6": seeds draw the benchmark's scenes.
        scene: Name or JSON file of a scene that seeds vary, or with `task` a concrete one.
        query: The sentence, planned offline; with `task`, what it is called.
        task: What is to be done in a concrete scene, which no seed changes.
        observation_mode: What is observed beside the robot itself.
        action_mode: What actions are, as `executor.robot.actions` defines them.
        normalised: Whether actions lie between -1 and 1, for the least and the most of each number.
        rate_hz: Actions a second of simulated time.
        size: Width and height of pictures.
        render_mode: "rgb_array": `render` draws the global view.
        physics: Of a world that a demonstration varied.
        variation: What seeds vary beside layout and places, where they draw something.
        full_size: Whether the robot is of full size; a concrete scene says so itself.
        start: Where the episode of `task` begins, when it is not where its scene has everything.

    Attributes:
        family: As given.
        task: The family, or the sentence.
        task_description: The sentence of the present episode.

    Raises:
        ValueError: Arguments contradict each other.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  (as Gymnasium has it)

    def __init__(
        self,
        family: Family | None = None,
        *,
        scene: str | Path | Scene | None = None,
        query: str = "",
        task: Task | None = None,
        observation_mode: ObservationMode = "state",
        action_mode: ActionMode = "joint_target",
        normalised: bool = False,
        rate_hz: float = 10.0,
        size: tuple[int, int] = (128, 128),
        render_mode: str | None = None,
        physics: Physics = STANDARD,
        variation: Variation = UNVARIED,
        full_size: bool = False,
        start: Checkpoint | None = None,
    ) -> None:
        # What a copy is built of again; only arguments are local here yet.
        self._arguments = {name: value for name, value in locals().items() if name != "self"}
        self.family = family
        self._source = _source(family, scene, query, task, physics, variation, full_size, start)
        self._scale = scene.robot.scale if isinstance(scene, Scene) else FULL_SCALE if full_size else PAPER_SCALE
        _known("observation_mode", observation_mode, ("state", "point_cloud", "pixels"))
        _known("action_mode", action_mode, ("joint_target", "paper"))
        _known("render_mode", render_mode, (None, "rgb_array"))
        if not 1.0 <= rate_hz <= 1.0 / TIMESTEP_S:
            raise ValueError(f"rate_hz {rate_hz}: expected 1 to {1.0 / TIMESTEP_S:.0f}")
        self._size = check_size((int(size[0]), int(size[1])))
        self._modes = (observation_mode, action_mode)
        self._rate_hz, self._normalised, self.render_mode = rate_hz, normalised, render_mode
        self._limits = action_limits(action_mode, rate_hz, self._scale)
        low, high = (-np.ones(len(self._limits[0])), np.ones(len(self._limits[0]))) if normalised else self._limits
        self.action_space = spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        self.observation_space = _observation_space(observation_mode, self._size)
        # What writes videos wants a whole number.
        fps = round(1.0 / (steps_each(rate_hz) * TIMESTEP_S))
        self.metadata = {**type(self).metadata, "render_fps": fps}
        self.task = family or query or (task.name if task is not None else "")
        self.task_description = query or self.task
        self._episode: DrawnEpisode | None = None
        self._simulation: Simulation | None = None
        self._views: Views | None = None
        self._seed_now = 0

    def __getstate__(self) -> dict[str, Any]:
        """Returns what a copy is made of, by `copy` or `pickle`: arguments and random numbers, and no episode.

        The simulator's objects cannot be copied. A copy is an environment as it was when it was made, and `reset` of a
        seed begins the same episode in it; without a seed, the next one that `reset` of this environment would draw.
        """
        return {"arguments": self._arguments, "spec": self.spec, "random": (self._np_random, self._np_random_seed)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state["arguments"])  # type: ignore[misc]
        self.spec = state["spec"]
        self._np_random, self._np_random_seed = state["random"]

    @property
    def _max_episode_steps(self) -> int | None:
        """After how many actions Gymnasium's time limit ends an episode, where one was asked for."""
        return None if self.spec is None else self.spec.max_episode_steps

    @property
    def target(self) -> Array:
        """(12,) joint targets that the drives hold now."""
        return self._running().target.copy()

    @property
    def episode(self) -> DrawnEpisode:
        """What the present episode is about."""
        self._running()
        assert self._episode is not None
        return self._episode

    @property
    def world(self) -> World:
        """The physics of the present episode, to be looked at."""
        return self._running().world

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode.

        Args:
            seed: The benchmark's seed; without one, the next of this environment's own random numbers.
            options: {"index": number}: which pair of a set of T5 or T6; by default the seed says which.

        Returns:
            The observation, and what is known beside it.

        Raises:
            ValueError: There is no such seed or index, or the scene's robot is of another size.
            NotDrawn: No room could be made of this seed.
        """
        super().reset(seed=seed)
        index = (options or {}).get("index")
        episode = self._drawn(seed, None if index is None else int(index))
        if episode.scene.robot.scale != self._scale:
            raise ValueError(
                f"{self.task}: the scene's robot is of full size; make the environment with full_size=True"
            )
        self._episode, self.task_description = episode, episode.query
        return self._begin(episode, episode.start)

    def checkpoint(self) -> Checkpoint:
        """Returns where the present episode has come to, for a planner to go on from."""
        return checkpoint_of(self.world, float(self.target[-1]))

    def resume(self, start: Checkpoint) -> tuple[Observation, dict[str, Any]]:
        """Goes on with the present episode from where somebody else has brought it.

        Returns:
            The observation, and what is known beside it.
        """
        return self._begin(self.episode, start)

    def disturb(self, before_step: Callable[[World], None]) -> None:
        """Has something called before every step of the physics of the present episode: what pushes on things."""
        self._running().before_step = before_step

    def wait(self) -> tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]:
        """Lets the time of an action go by, all drives held where they are; returns what `step` does."""
        return self._advanced(self._running().target)

    def _begin(self, episode: DrawnEpisode, start: Checkpoint) -> tuple[Observation, dict[str, Any]]:
        self._leave()
        follows = self._modes[1] == "paper"
        speeds = FOLLOWING_SPEEDS if follows else SPEEDS
        self._simulation = Simulation(episode.scene, start, self._rate_hz, episode.physics, speeds)
        self._follower = self._following() if follows else None
        world = self._simulation.world
        self._reader = StateReader(world, episode.task)
        self._watch = ProgressWatch(episode.graph, world)
        if self._modes[0] == "point_cloud":
            self._cloud = CloudReader(world, named(episode.task, world.assets), self._seed_now)
        progress = self._watch.look()
        self._value = progress.value
        return self._observed(), self._told(progress)

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]:
        """Does an action.

        Args:
            action: Of `action_space`; what is beyond it counts as its edge.

        Returns:
            The observation, the progress that was made, whether the goal has held, False, and what is known beside it.

        Raises:
            ValueError: It has another shape, or a number that is not finite; the episode stays as it was.
        """
        simulation = self._running()
        wanted = self._meant(action)
        if self._follower is not None:
            wanted = self._follower.joint_target(simulation.target, wanted)
        return self._advanced(wanted)

    def _advanced(self, wanted: Array) -> tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]:
        self._running().advance(wanted)
        progress = self._watch.look()
        reward, self._value = progress.value - self._value, progress.value
        return self._observed(), reward, progress.success, False, self._told(progress)

    def render(self) -> Picture | None:
        """Returns the (H, W, 3) global view, where the render mode is "rgb_array".

        Raises:
            RendererNotFound: Nothing on this machine can draw.
        """
        return self._pictures()["global"] if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Lets go of the simulator's objects; `reset` begins anew."""
        if self._views is not None:
            self._views.close()
            self._views = None
        self._leave()

    def _drawn(self, seed: int | None, index: int | None) -> DrawnEpisode:
        if seed is not None:
            self._seed_now = check_seed(seed)
            return self._source(self._seed_now, index)
        for draw in range(_DRAWS):
            self._seed_now = int(self.np_random.integers(LARGEST_SEED))
            try:
                return self._source(self._seed_now, index)
            except NotDrawn:
                if draw + 1 == _DRAWS:
                    raise
        raise AssertionError("the last draw returns or raises")

    def _meant(self, action: NDArray[np.float32]) -> Array:
        """Returns what an action is in m, rad and shares."""
        low, high = self._limits
        given = np.asarray(action, dtype=float)
        if given.shape != low.shape:
            raise ValueError(f"the action has the shape {given.shape}: expected {low.shape}")
        if not np.isfinite(given).all():
            wrong = ", ".join(f"number {k} is {given[k]}" for k in np.flatnonzero(~np.isfinite(given)))
            raise ValueError(f"the action cannot be done: {wrong}; expected finite numbers")
        return np.clip(low + (given + 1.0) / 2.0 * (high - low) if self._normalised else given, low, high)

    def _observed(self) -> Observation:
        found: Observation = {"agent_pos": self._reader.agent()}
        if self._modes[0] == "state":
            found["environment_state"] = self._reader.environment()
        elif self._modes[0] == "point_cloud":
            found["point_cloud"] = self._cloud.read()
        else:
            found["pixels"] = self._pictures()
        return found

    def _told(self, progress: Progress) -> dict[str, Any]:
        return {
            "is_success": progress.success,
            "success": progress.success,
            "progress": progress.value,
            "stage": progress.stage,
            "seed": self._seed_now,
            "query": self.task_description,
        }

    def _pictures(self) -> dict[str, Picture]:
        simulation, episode = self._running(), self._episode
        assert episode is not None
        if self._views is None:
            self._views = Views(self._size)
        return self._views.show(episode.scene, episode.task, simulation.world.pack())

    def _running(self) -> Simulation:
        if self._simulation is None:
            raise gymnasium.error.ResetNeeded("call reset before anything else")
        return self._simulation

    def _following(self) -> HandFollower:
        simulation = self._running()
        return HandFollower(self._scale, simulation.target, simulation.period_s, Elbow(simulation.world))

    def _leave(self) -> None:
        if self._simulation is not None:
            self._simulation.world.close()
            self._simulation = None


def action_limits(mode: ActionMode, rate_hz: float, scale: float) -> tuple[Array, Array]:
    """Returns the least and the most of each number of an action, in m, rad and shares.

    Args:
        mode: What actions are.
        rate_hz: Actions a second; differences are smaller when there are more of them.
        scale: The robot's, of a Panda's full size.
    """
    limits = joint_limits(scale)
    if mode == "joint_target":
        return limits[:, 0], limits[:, 1]
    # A base that drives along both of its room's axes at once is faster along its own.
    driving = SPEEDS[:3] * [np.sqrt(2.0), np.sqrt(2.0), 1.0]
    most = np.array([*[_HAND_SPEED_M_S] * 3, *[_HAND_TURN_RAD_S] * 3, 0.0, *driving]) / rate_hz
    most[-3:] *= 1.001
    low, high = -most, most
    pressing_m, opening_m = limits[-1]
    low[6], high[6] = pressing_m / opening_m, 1.0
    assert len(low) == HAND_NUMBERS
    return low, high


def _observation_space(mode: ObservationMode, size: tuple[int, int]) -> spaces.Dict:
    def numbers(*shape: int) -> spaces.Box:
        return spaces.Box(-LARGEST, LARGEST, shape, np.float32)

    seen: dict[str, spaces.Space[Any]] = {"agent_pos": numbers(AGENT)}
    if mode == "state":
        seen["environment_state"] = numbers(ENVIRONMENT)
    elif mode == "point_cloud":
        seen["point_cloud"] = numbers(POINTS, 4)
    else:
        picture = (size[1], size[0], 3)
        seen["pixels"] = spaces.Dict({view: spaces.Box(0, 255, picture, np.uint8) for view in VIEWS})
    return spaces.Dict(seen)


def _source(
    family: Family | None,
    scene: str | Path | Scene | None,
    query: str,
    task: Task | None,
    physics: Physics,
    variation: Variation,
    full_size: bool,
    start: Checkpoint | None,
) -> Source:
    """Returns where episodes come from.

    Raises:
        ValueError: It is not said, or said twice.
    """
    if family is not None and scene is None and task is None and not query:
        return of_family(family, variation, full_size=full_size)
    if family is None and task is not None and isinstance(scene, Scene):
        return of_task(task, scene, query, physics, start)
    if family is None and task is None and query and isinstance(scene, str | Path):
        return of_query(query, str(scene), variation, full_size=full_size)
    raise ValueError("expected a family; or a scene (name or file) and a query; or a concrete Scene and a Task")


def _known(name: str, value: object, values: tuple[object, ...]) -> None:
    if value not in values:
        raise ValueError(f"{name} {value!r}: expected one of {', '.join(repr(known) for known in values)}")
