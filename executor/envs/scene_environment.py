"""Gymnasium environment of an episode: its physics at the rate of actions, camera views, and the interface itself.

Drive targets move evenly between two actions, and no faster than their limits. Cameras see a second world that takes on
the state of the first.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal, SupportsFloat

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from executor.data.state_readers import (
    ENVIRONMENT,
    LARGEST,
    POINTS,
    CloudReader,
    StateReader,
    agent_numbers,
    named_objects,
)
from executor.data.units import UNVARIED, Variation
from executor.envs.episodes import (
    DrawnEpisode,
    EpisodeSource,
    Progress,
    ProgressWatch,
    family_source,
    query_source,
    task_source,
)
from executor.envs.hand_control import Elbow, HandFollower, arm_speeds
from executor.geometry import Array
from executor.rollouts.checkpoint import Checkpoint
from executor.scenes.file import load_scene
from executor.scenes.generators.families import Family, varies_with_seed
from executor.scenes.pair import NotDrawn
from executor.scenes.vary import LARGEST_SEED, check_seed
from executor.sim.engine import STANDARD, TIMESTEP_S, Physics
from executor.sim.render.cameras import VIEWS, cameras_for
from executor.sim.render.frames import Picture, check_size
from executor.sim.render.home import home_of
from executor.sim.render.stage import DAYLIGHT, SceneRenderer, Stage
from executor.sim.robot.actions import BASE_NUMBERS_FROM, OPENING, hand_numbers, joint_limits
from executor.sim.world import World
from executor.skills.control import FINGER_SPEED_M_S
from executor.skills.trajectories import speed_limits
from oag import Scene, Task
from oag.model.robots import FULL_SIZE, PAPER_ROBOT, Robot, chosen_robot, known_robot, robot_named


class Views:
    """The three cameras, in one scene after the other."""

    def __init__(self, size: tuple[int, int], *, plain: bool = False) -> None:
        self._size, self._plain = size, plain
        self._draughtsman = SceneRenderer()
        self._open = ExitStack()
        self._scene: Scene | None = None
        self._stage: Stage | None = None

    def show(self, scene: Scene, task: Task, state: bytes) -> dict[str, Picture]:
        """Return view name -> (H, W, 3) uint8 RGB of a packed physical state of a scene.

        Args:
            scene: The concrete scene; a new one builds a new stage.
            task: Its objects have to be visible in the global view.
            state: A state from `World.pack`.
        """
        if self._stage is None or scene is not self._scene:
            self._leave()
            width, height = self._size
            cameras = cameras_for(scene, VIEWS, aspect=width / height, task=task, height_px=height)
            home = None if self._plain else home_of(scene)
            lights, surfaces = (DAYLIGHT, None) if home is None else (home.lights, home.surfaces)
            sizes = dict.fromkeys(VIEWS, self._size)
            drawn = self._draughtsman.stage(scene, cameras, sizes, lights=lights, materials=surfaces)
            self._stage = self._open.enter_context(drawn)
            self._scene = scene
        return self._stage.show(state)

    def close(self) -> None:
        """Release the renderer's objects; rendering is impossible afterwards."""
        self._leave()
        self._draughtsman.close()

    def _leave(self) -> None:
        self._stage = None
        self._open.close()


SLACK = 1.001  # Slack of speed limits: recorded targets are rounded.


def target_speeds(robot: Robot, *, following: bool = False) -> Array:
    """Return (J,) the speed limits of targets, those of planned motions, m/s and rad/s; base, arm, fingers.

    Args:
        following: Whether the arm follows hand actions.
    """
    planned = speed_limits(robot)
    arm = arm_speeds(robot) if following else planned[robot.arm]
    return np.array([*planned[robot.base], *arm, FINGER_SPEED_M_S, FINGER_SPEED_M_S])


def steps_each(rate_hz: float, timestep_s: float = TIMESTEP_S) -> int:
    """Return the number of physics steps of an action; recorded samples are equally spaced."""
    return max(round(1.0 / (rate_hz * timestep_s)), 1)


class Simulation:
    """Physics of one episode.

    Args:
        rate_hz: Actions per second of simulated time.
        physics: Changed physics of an experiment or a varied demonstration.
        follows: Whether the arm follows hand actions.

    Attributes:
        target: (J,) present joint targets of the drives.
    """

    def __init__(
        self, scene: Scene, start: Checkpoint, rate_hz: float, physics: Physics = STANDARD, *, follows: bool = False
    ) -> None:
        self.world, control = start.restore(scene, lambda: None, physics=physics)
        # The engine finds contacts by stepping, and a restored world has none.
        control.settle(self.world.timestep_s)
        self._each = steps_each(rate_hz, self.world.timestep_s)
        self.period_s = self._each * self.world.timestep_s
        self._joints = list(self.world.robot.active_joints)
        self._low, self._high = joint_limits(scene.robot.model).T
        self._speeds = target_speeds(scene.robot.model, following=follows)
        self._movers = scene.robot.model.movers  # Base and arm; fingers press, without a velocity target.
        self.target = np.array([*control.target, control.finger_target_m, control.finger_target_m])

    def advance(self, wanted: Array) -> None:
        """Move the drive targets towards new ones until the next action is due.

        Between two actions each target moves evenly. It moves no faster than its limit, and then ends short. Actions
        are due at whole multiples of the period, as samples of demonstrations are taken.

        Args:
            wanted: (J,) joint targets.
        """
        world, movers = self.world, self._movers
        count = self._each - world.steps % self._each
        duration_s = count * world.timestep_s
        start = self.target.copy()
        # Targets of pressing fingers lie far beyond their positions; they return from the positions.
        held_m = np.asarray(world.robot.get_qpos(), dtype=float)[movers:]
        wanted = np.clip(np.asarray(wanted, dtype=float), self._low, self._high)
        start[movers:] = np.clip(
            held_m, np.minimum(start[movers:], wanted[movers:]), np.maximum(start[movers:], wanted[movers:])
        )
        most = SLACK * duration_s * self._speeds
        change = np.clip(wanted - start, -most, most)
        for joint, speed in zip(self._joints[:movers], (change[:movers] / duration_s).tolist(), strict=True):
            joint.set_drive_velocity_target(speed)
        # Constant targets are set once: setting costs a tenth of a physics step.
        moving = [k for k in range(len(change)) if change[k] or start[k] != self.target[k]]
        tell = [self._joints[k].set_drive_target for k in moving]
        for targets in (start + np.linspace(0.0, 1.0, count + 1)[1:, None] * change)[:, moving].tolist():
            for tell_joint, target in zip(tell, targets, strict=True):
                tell_joint(target)
            world.step()
        self.target = start + change


Observation = dict[str, Any]
ActionMode = Literal["joint_target", "paper"]
ObservationMode = Literal["state", "point_cloud", "pixels"]

_HAND_SPEED_M_S, _HAND_TURN_RAD_S = 1.2, 4.0  # Several joints at their speed limits together.
_DRAWS = 5  # Own seeds that are tried where no room can be drawn for one.


class SceneEnvironment(gymnasium.Env[Observation, NDArray[np.float32]]):
    """Mobile robot in a room with a task; docs/datasets.md has observations and actions.

    Args:
        family: "T1" to "T6": seeds draw the benchmark's scenes.
        scene: Name or JSON file of a scene that seeds vary, or with `task` a concrete one.
        query: The sentence, planned offline; with `task`, its text.
        task: Task in a concrete scene, which no seed changes.
        observation_mode: Observations besides the robot itself.
        action_mode: Kind of actions, see `executor.sim.robot.actions`.
        normalised: Whether actions lie between -1 and 1, for the minimum and maximum of each number.
        rate_hz: Actions a second of simulated time.
        size: Width and height of pictures.
        render_mode: "rgb_array": `render` draws the global view.
        plain: Whether pictures have assets in their own colours, without their home.
        physics: Physics of a varied demonstration.
        variation: Variation of seeds besides layout and places, where they draw something.
        full_size: Another word for the robot "panda".
        robot: Name of the robot; by default the scene's own, or the paper's. A concrete scene has its own.
        start: Start of the episode of `task`, if it is not the scene's.

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
        robot: str = "",
        plain: bool = False,
    ) -> None:
        # Arguments for copies; no other locals exist here yet.
        self._arguments = {name: value for name, value in locals().items() if name != "self"}
        self.family = family
        chosen = known_robot(chosen_robot(robot, full_size=full_size))
        self._episode_source = _episode_source(family, scene, query, task, physics, variation, chosen, start)
        self._robot = _robot_of(scene, chosen)
        _check_choice("observation_mode", observation_mode, ("state", "point_cloud", "pixels"))
        _check_choice("action_mode", action_mode, ("joint_target", "paper"))
        _check_choice("render_mode", render_mode, (None, "rgb_array"))
        if not 1.0 <= rate_hz <= 1.0 / TIMESTEP_S:
            raise ValueError(f"rate_hz {rate_hz}: expected 1 to {1.0 / TIMESTEP_S:.0f}")
        self._size, self._plain = check_size((int(size[0]), int(size[1]))), plain
        self._modes = (observation_mode, action_mode)
        self._rate_hz, self._normalised, self.render_mode = rate_hz, normalised, render_mode
        self._limits = action_limits(action_mode, rate_hz, self._robot)
        low, high = (-np.ones(len(self._limits[0])), np.ones(len(self._limits[0]))) if normalised else self._limits
        self.action_space = spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        self.observation_space = _observation_space(observation_mode, self._size, self._robot)
        # Video writers need an integer.
        fps = round(1.0 / (steps_each(rate_hz) * TIMESTEP_S))
        self.metadata = {**type(self).metadata, "render_fps": fps}
        self.task = family or query or (task.name if task is not None else "")
        self.task_description = query or self.task
        self._episode: DrawnEpisode | None = None
        self._simulation: Simulation | None = None
        self._views: Views | None = None
        self._seed_now = 0

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy, by `copy` or `pickle`: arguments and random numbers, without the episode.

        The simulator's objects cannot be copied. A copy is a fresh environment, and `reset` with a seed begins the same
        episode in it. Without a seed it begins the one that `reset` of this environment would draw next.
        """
        return {"arguments": self._arguments, "spec": self.spec, "random": (self._np_random, self._np_random_seed)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state["arguments"])  # type: ignore[misc]
        self.spec = state["spec"]
        self._np_random, self._np_random_seed = state["random"]

    @property
    def _max_episode_steps(self) -> int | None:
        """Number of actions of Gymnasium's time limit, if there is one."""
        return None if self.spec is None else self.spec.max_episode_steps

    @property
    def target(self) -> Array:
        """(J,) present joint targets of the drives."""
        return self._running().target.copy()

    @property
    def episode(self) -> DrawnEpisode:
        """The present episode."""
        self._running()
        assert self._episode is not None
        return self._episode

    @property
    def world(self) -> World:
        """The physics of the present episode, for inspection."""
        return self._running().world

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: The benchmark's seed; without one, the next of this environment's own random numbers.
            options: {"index": number}: the pair of a set of T5 or T6; by default the seed decides.

        Returns:
            The observation, and the info.

        Raises:
            ValueError: There is no such seed or index, or the scene's robot is another one.
            NotDrawn: No room could be drawn for this seed.
        """
        super().reset(seed=seed)
        index = (options or {}).get("index")
        episode = self._drawn(seed, None if index is None else int(index))
        if (found := episode.scene.robot.model) is not self._robot:
            word = "full_size=True" if found is FULL_SIZE else f"robot={found.name!r}"
            raise ValueError(f"{self.task}: the scene's robot is a {found.words}; make the environment with {word}")
        self._episode, self.task_description = episode, episode.query
        self._leave()
        follows = self._modes[1] == "paper"
        self._simulation = Simulation(episode.scene, episode.start, self._rate_hz, episode.physics, follows=follows)
        world = self._simulation.world
        self._follower = (
            HandFollower(self._robot, self._simulation.target, self._simulation.period_s, Elbow(world))
            if follows
            else None
        )
        self._reader = StateReader(world, episode.task)
        self._watch = ProgressWatch(episode.graph, world)
        if self._modes[0] == "point_cloud":
            self._cloud = CloudReader(world, named_objects(episode.task, world.assets), self._seed_now)
        progress = self._watch.look()
        self._value = progress.value
        return self._observe(), self._info(progress)

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]:
        """Execute an action.

        Args:
            action: An action of `action_space`; values beyond it are clipped.

        Returns:
            The observation, the gained progress, whether the goal has held, False, and the info.

        Raises:
            ValueError: It has another shape, or a number that is not finite; the episode stays as it was.
        """
        simulation = self._running()
        wanted = self._physical_action(action)
        if self._follower is not None:
            wanted = self._follower.joint_target(simulation.target, wanted)
        simulation.advance(wanted)
        progress = self._watch.look()
        reward, self._value = progress.value - self._value, progress.value
        return self._observe(), reward, progress.success, False, self._info(progress)

    def render(self) -> Picture | None:
        """Return the (H, W, 3) global view, where the render mode is "rgb_array"."""
        return self._pictures()["global"] if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Release the simulator's objects; `reset` starts again."""
        if self._views is not None:
            self._views.close()
            self._views = None
        self._leave()

    def _drawn(self, seed: int | None, index: int | None) -> DrawnEpisode:
        if seed is not None:
            self._seed_now = check_seed(seed)
            return self._episode_source(self._seed_now, index)
        for draw in range(_DRAWS):
            self._seed_now = int(self.np_random.integers(LARGEST_SEED))
            try:
                return self._episode_source(self._seed_now, index)
            except NotDrawn:
                if draw + 1 == _DRAWS:
                    raise
        raise AssertionError("the last draw returns or raises")

    def _physical_action(self, action: NDArray[np.float32]) -> Array:
        low, high = self._limits
        given = np.asarray(action, dtype=float)
        if given.shape != low.shape:
            raise ValueError(f"the action has the shape {given.shape}: expected {low.shape}")
        if not np.isfinite(given).all():
            wrong = ", ".join(f"number {k} is {given[k]}" for k in np.flatnonzero(~np.isfinite(given)))
            raise ValueError(f"the action cannot be done: {wrong}; expected finite numbers")
        return np.clip(low + (given + 1.0) / 2.0 * (high - low) if self._normalised else given, low, high)

    def _observe(self) -> Observation:
        found: Observation = {"agent_pos": self._reader.agent()}
        if self._modes[0] == "state":
            found["environment_state"] = self._reader.environment()
        elif self._modes[0] == "point_cloud":
            found["point_cloud"] = self._cloud.read()
        else:
            found["pixels"] = self._pictures()
        return found

    def _info(self, progress: Progress) -> dict[str, Any]:
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
            self._views = Views(self._size, plain=self._plain)
        return self._views.show(episode.scene, episode.task, simulation.world.pack())

    def _running(self) -> Simulation:
        if self._simulation is None:
            raise gymnasium.error.ResetNeeded("call reset before anything else")
        return self._simulation

    def _leave(self) -> None:
        if self._simulation is not None:
            self._simulation.world.close()
            self._simulation = None


def action_limits(mode: ActionMode, rate_hz: float, robot: Robot) -> tuple[Array, Array]:
    """Return the minimum and maximum of each number of an action, in m, rad and shares.

    Args:
        rate_hz: Actions per second; differences shrink with it.
    """
    limits = joint_limits(robot)
    if mode == "joint_target":
        return limits[:, 0], limits[:, 1]
    # Driving along both room axes at once is faster along the base's own.
    driving = speed_limits(robot)[robot.base].copy()
    driving[:2] *= np.sqrt(2.0)
    most = np.array([*[_HAND_SPEED_M_S] * 3, *[_HAND_TURN_RAD_S] * 3, 0.0, *driving]) / rate_hz
    most[BASE_NUMBERS_FROM:] *= 1.001
    low, high = -most, most
    pressing_m, opening_m = limits[-1]
    low[OPENING], high[OPENING] = pressing_m / opening_m, 1.0
    assert len(low) == hand_numbers(robot)
    return low, high


def _observation_space(mode: ObservationMode, size: tuple[int, int], robot: Robot) -> spaces.Dict:
    def numbers(*shape: int) -> spaces.Box:
        return spaces.Box(-LARGEST, LARGEST, shape, np.float32)

    parts: dict[str, spaces.Space[Any]] = {"agent_pos": numbers(agent_numbers(robot))}
    if mode == "state":
        parts["environment_state"] = numbers(ENVIRONMENT)
    elif mode == "point_cloud":
        parts["point_cloud"] = numbers(POINTS, 4)
    else:
        picture = (size[1], size[0], 3)
        parts["pixels"] = spaces.Dict({view: spaces.Box(0, 255, picture, np.uint8) for view in VIEWS})
    return spaces.Dict(parts)


def _episode_source(
    family: Family | None,
    scene: str | Path | Scene | None,
    query: str,
    task: Task | None,
    physics: Physics,
    variation: Variation,
    robot: str,
    start: Checkpoint | None,
) -> EpisodeSource:
    """Return the source of episodes.

    Raises:
        ValueError: There is none, or more than one.
    """
    if family is not None and scene is None and task is None and not query:
        return family_source(family, variation, robot=robot)
    if family is None and task is not None and isinstance(scene, Scene):
        return task_source(task, scene, query, physics, start)
    if family is None and task is None and query and isinstance(scene, str | Path):
        return query_source(query, str(scene), variation, robot=robot)
    raise ValueError("expected a family; or a scene (name or file) and a query; or a concrete Scene and a Task")


def _robot_of(scene: str | Path | Scene | None, chosen: str) -> Robot:
    if isinstance(scene, Scene):
        return scene.robot.model
    if chosen or scene is None:
        return robot_named(chosen or PAPER_ROBOT.name)
    # The kitchens that seeds draw are for the paper's robot.
    return PAPER_ROBOT if varies_with_seed(str(scene)) else load_scene(scene).robot.model


def _check_choice(name: str, value: object, values: tuple[object, ...]) -> None:
    if value not in values:
        raise ValueError(f"{name} {value!r}: expected one of {', '.join(repr(known) for known in values)}")
