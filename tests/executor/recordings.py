"""Rollout records for tests: invented ones without a simulator, and scripted ones that the physics really moved."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

from executor.geometry import pose_vector
from executor.records import Failure, FailureKind, Rollout, StepRecord, SubtaskRecord, Trajectory
from executor.scenes import library
from executor.sim.world import World
from oag import Scene, Task
from oag.measurements import AtomMeasured, GoalReading, GripMeasured, HandMeasured
from oag.model.actions import flow_from_json

TASK = {
    "task_activity_name": "put_glass_into_refrigerator",
    "task_detail_message": "Put the glass into the refrigerator & <shut> it.",
    "goal": "(and (inside glass_0 refrigerator_0) (not (open refrigerator_0)))",
    "scales": {"glass_0": 0.71},
    "sub_tasks": [
        {
            "task_activity_name": "open_refrigerator",
            "task_detail_message": "Open the door of the refrigerator.",
            "target": "refrigerator_0",
            "support_init": None,
            "support_goal": None,
            "init": "(not (open refrigerator_0))",
            "goal": "(open refrigerator_0)",
            "flow": [17, 1, 2, 3, {"4": [0.0, 0.85]}, 5, 6],
        },
        {
            "task_activity_name": "pick_up_glass",
            "task_detail_message": "Pick up the glass.",
            "target": "glass_0",
            "support_init": "table_0",
            "support_goal": None,
            "init": "(ontop glass_0 table_0)",
            "goal": "(not (ontop glass_0 table_0))",
            "flow": [17, 1, 2, 3, {"7": 0.12}],
        },
    ],
}
RATE_HZ = 10.0
STEP_S = 0.7


def task_for(scene: Scene) -> Task:
    """Return the two-subtask task that all recordings are of."""
    return Task.from_json(TASK, scene=scene)


def invented_rollout(*, failed: bool = False, samples: int | None = None) -> Rollout:
    """Return a record with plausible numbers and packed states that no engine wrote.

    Args:
        failed: Ends the second subtask at its GRASP with a typed failure.
        samples: Keeps only the first samples, as after an interruption.
    """
    scene = library.load("kitchen_t1").with_scales(TASK["scales"])
    task = task_for(scene)
    subtasks = _subtasks(task, failed)
    rows = [(s.subtask, s.step) for sub in subtasks for s in sub.steps for _ in range(round(STEP_S * RATE_HZ))]
    count = len(rows) if samples is None else samples
    wave = np.linspace(0.0, 1.0, max(len(rows), 1))[:count, None]
    qpos = np.hstack([0.3 * wave, -0.2 * wave, wave, *[0.1 * wave] * 7, 0.028 - 0.01 * wave, 0.028 - 0.01 * wave])
    poses = np.tile(np.array([0.0, -1.12, 0.64, 1.0, 0.0, 0.0, 0.0]), (count, 1))
    trajectory = Trajectory(
        time_s=np.arange(1, count + 1) / RATE_HZ,
        robot_qpos=qpos.astype(np.float32),
        robot_qvel=np.zeros((count, 12), np.float32),
        robot_target=np.hstack([qpos[:, :10] + 0.001, qpos[:, 10:]]).astype(np.float32),
        eef_pose=poses.astype(np.float32),
        object_poses={"glass_0": poses.astype(np.float32)} if count else {},
        joint_positions={"refrigerator_0": wave.astype(np.float32)} if count else {},
        subtask=np.array([row[0] for row in rows[:count]], np.int32),
        step=np.array([row[1] for row in rows[:count]], np.int32),
        packed_states=tuple(bytes([k % 256] * 8) for k in range(count)),
    )
    goals = (GoalReading("inside(glass_0, refrigerator_0)", True, not failed, AtomMeasured(centre_depth_m=0.02)),)
    return _rollout(scene, task, subtasks, () if failed else goals, trajectory)


def scripted_rollout(scene_name: str = "kitchen_t1", seconds: float = 1.0) -> Rollout:
    """Return a record of the robot driving and waving in the real physics, without any task done."""
    scene = library.load(scene_name)
    task = task_for(library.load("kitchen_t1"))
    with World(scene) as world:
        every = round(1.0 / (RATE_HZ * world.timestep_s))
        joints = list(world.robot.active_joints)
        start = np.asarray(world.robot.get_qpos(), dtype=float)
        rows: dict[str, list[np.ndarray]] = {"qpos": [], "qvel": [], "target": [], "eef": []}
        objects: dict[str, list[np.ndarray]] = {name: [] for name in world.dynamic_ids}
        hinges: dict[str, list[list[float]]] = {name: [] for name in world.articulated_ids}
        times, packed = [], []
        for k in range(1, round(seconds / world.timestep_s) + 1):
            phase = k * world.timestep_s / max(seconds, 1e-9)
            target = start + phase * np.array([-0.15, -0.3, -1.2, 0.4, 0.5, 0.0, 0.3, 0.0, 0.3, 0.0, 0.0, 0.0])
            for joint, value in zip(joints, target, strict=True):
                joint.set_drive_target(float(value))
            world.step()
            if k % every:
                continue
            times.append(world.time_s)
            packed.append(world.pack())
            rows["qpos"].append(np.asarray(world.robot.get_qpos()))
            rows["qvel"].append(np.asarray(world.robot.get_qvel()))
            rows["target"].append(target)
            rows["eef"].append(pose_vector(world.T_world_link("robot", "panda_hand")))
            for name, column in objects.items():
                column.append(pose_vector(world.T_world_link(name)))
            for name, angles in hinges.items():
                angles.append([world.joint_position(name, joint.name) for joint in world.assets[name].joints])
    count = len(times)
    subtasks = _subtasks(task, failed=False)
    steps = sum(len(subtask.steps) for subtask in subtasks)
    order = [(s.subtask, s.step) for subtask in subtasks for s in subtask.steps]
    running = [order[min(i * steps // max(count, 1), steps - 1)] for i in range(count)]
    trajectory = Trajectory(
        time_s=np.array(times),
        robot_qpos=np.array(rows["qpos"], np.float32),
        robot_qvel=np.array(rows["qvel"], np.float32),
        robot_target=np.array(rows["target"], np.float32),
        eef_pose=np.array(rows["eef"], np.float32),
        object_poses={name: np.array(column, np.float32) for name, column in objects.items()},
        joint_positions={name: np.array(column, np.float32) for name, column in hinges.items()},
        subtask=np.array([r[0] for r in running], np.int32),
        step=np.array([r[1] for r in running], np.int32),
        packed_states=tuple(packed),
    )
    return _rollout(scene, task, subtasks, (), trajectory)


def _subtasks(task: Task, failed: bool) -> tuple[SubtaskRecord, ...]:
    made, now = [], 0.0
    for index, subtask in enumerate(task.subtasks):
        steps = []
        for number, action in enumerate(subtask.flow or ()):
            name = action.primitive.name
            broken = failed and index == 1 and name == "GRASP"
            failure = None
            if broken:
                failure = Failure(
                    FailureKind.GRASP_MISSED,
                    "the fingers closed on nothing <where> the glass should be",
                    (GripMeasured(opening_m=0.0004, fingers_touching=0),),
                )
            evidence = (HandMeasured(residual_m=0.0012, eef_position_m=(0.1, 0.2, 0.3)),)
            steps.append(StepRecord(index, number, name, action.to_json(), now, now + STEP_S, 0.1, evidence, failure))
            now += STEP_S
            if broken:
                break
        reading = GoalReading("open(refrigerator_0)", True, True, AtomMeasured(angle_deg=95.0))
        digest = hashlib.sha256(str(index).encode()).hexdigest()
        flow = flow_from_json([step.action for step in steps])
        made.append(SubtaskRecord(index, subtask.name, flow, tuple(steps), (reading,), digest, b"state"))
    return tuple(made)


def _rollout(
    scene: Scene,
    task: Task,
    subtasks: tuple[SubtaskRecord, ...],
    goals: tuple[GoalReading, ...],
    trajectory: Trajectory,
) -> Rollout:
    digest = hashlib.sha256(b"".join(trajectory.packed_states)).hexdigest()
    task = replace(task, scene=scene)
    return Rollout(task, scene, 3, 10.0, subtasks, goals, trajectory, digest, 8.4, 1.5, 2.5)
