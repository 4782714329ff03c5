"""The samples of an episode as one compressed file, `samples.xz`.

A line of JSON says which arrays there are, `{"robot_qpos": ["<f4", [600, 12]], ...}`; their bytes follow in that order,
those of each array as [column, byte, row]. So neighbours in time stand side by side, and what the physics state and a
column have in common is stored once: a demonstration of a minute takes 130 kB, half of what a compressed archive of the
same arrays takes. Nothing in it is executed when it is read.
"""

from __future__ import annotations

import json
import lzma
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from executor.records.commands import DriveCommand
from executor.records.rollout import Rollout, Trajectory

Arrays = Mapping[str, NDArray]

MOST_BYTES = 2_000_000_000
"""Of arrays that are read from a file."""
_LONGEST_HEADER = 1 << 16
# What stands before a byte, and where it stands, says nothing of it. More effort takes five times the time for 2 %.
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 1, "lc": 0, "pb": 0}]
_KINDS = frozenset({"<f4", "<f8", "<i4", "|u1", "|b1"})


class BadSamples(ValueError):
    """A file is no file of samples, or not a whole one."""


def packed(arrays: Arrays) -> bytes:
    """Returns arrays as the content of a file of samples."""
    header = {name: (array.dtype.str, array.shape) for name, array in arrays.items()}
    if unknown := sorted({kind for kind, _ in header.values()} - _KINDS):
        raise TypeError(f"arrays of {', '.join(unknown)} are not kept; {', '.join(sorted(_KINDS))} are")
    parts = [json.dumps(header).encode() + b"\n", *(_planes(array) for array in arrays.values())]
    return lzma.compress(b"".join(parts), filters=_FILTERS)


def unpacked(content: bytes) -> dict[str, NDArray]:
    """Returns the arrays of a file of samples.

    Raises:
        BadSamples: It is none.
    """
    try:
        reader = lzma.LZMADecompressor()
        raw = reader.decompress(content, max_length=MOST_BYTES)
        header, _, rest = raw.partition(b"\n")
        found, at = {}, 0
        for name, (kind, shape) in json.loads(header).items():
            if kind not in _KINDS or any(side < 0 for side in shape):
                raise BadSamples(f"{name} is of no known kind")
            dtype, count = np.dtype(kind), int(np.prod(shape, dtype=np.int64))
            end = at + count * dtype.itemsize
            found[str(name)] = _rows(rest[at:end], dtype, tuple(shape))
            at = end
    except (lzma.LZMAError, ValueError, TypeError, AttributeError, RecursionError) as problem:
        raise BadSamples(f"not a file of samples: {problem}") from None
    if not reader.eof or at != len(rest):
        raise BadSamples("not a whole file of samples")
    return found


def shapes(begin: bytes) -> dict[str, tuple[int, ...]]:
    """Returns the shapes of the arrays of a file of samples, from its first bytes.

    Raises:
        BadSamples: It is none.
    """
    try:
        line, newline, _ = lzma.LZMADecompressor().decompress(begin, max_length=_LONGEST_HEADER).partition(b"\n")
        if not newline:
            raise BadSamples("its header does not end")
        return {str(name): tuple(int(side) for side in shape) for name, (_, shape) in json.loads(line).items()}
    except (lzma.LZMAError, ValueError, TypeError, AttributeError, RecursionError, EOFError) as problem:
        raise BadSamples(f"not a file of samples: {problem}") from None


def _planes(array: NDArray) -> bytes:
    rows = len(array) if array.ndim else 1
    flat = np.ascontiguousarray(array).reshape(rows, -1).view(np.uint8) if array.size else np.zeros((0, 0), np.uint8)
    return flat.reshape(rows, -1, array.dtype.itemsize).transpose(1, 2, 0).tobytes() if array.size else b""


def _rows(content: bytes, dtype: np.dtype, shape: tuple[int, ...]) -> NDArray:
    if 0 in shape:
        return np.zeros(shape, dtype)
    rows = shape[0] if shape else 1
    planes = np.frombuffer(content, np.uint8).reshape(-1, dtype.itemsize, rows)
    return np.ascontiguousarray(planes.transpose(2, 0, 1)).view(dtype).reshape(shape)


def columns(rollout: Rollout) -> dict[str, NDArray]:
    """Returns everything that is kept of a rollout as arrays; `docs/datasets.md` documents each.

    Args:
        rollout: What was recorded, at least one sample of it.
    """
    return motion_columns(rollout.trajectory, [record.commands for record in rollout.subtasks])


def motion_columns(motion: Trajectory, told: Sequence[Sequence[DriveCommand]]) -> dict[str, NDArray]:
    """Returns a recorded motion as arrays, with what the robot was told, subtask by subtask."""
    states = np.frombuffer(b"".join(motion.packed_states), "<f4").reshape(len(motion.time_s), -1)
    return {
        "packed_states": states,
        "time_s": motion.time_s,
        "subtask": motion.subtask,
        "step": motion.step,
        "robot_qpos": motion.robot_qpos,
        "robot_qvel": motion.robot_qvel,
        "robot_target": motion.robot_target,
        "eef_pose": motion.eef_pose,
        "object_poses": _stacked(list(motion.object_poses.values()), len(states), 7),
        "joint_positions": _flat(list(motion.joint_positions.values()), len(states)),
        **_command_columns(told),
    }


def commands(arrays: Arrays) -> tuple[tuple[DriveCommand, ...], ...]:
    """Returns what the robot was told, subtask by subtask, from the arrays that `columns` gives."""
    ends = np.cumsum(arrays["command_rows"])
    told: list[list[DriveCommand]] = [[] for _ in range(int(arrays["command_subtask"].max(initial=-1)) + 1)]
    for k, end in enumerate(ends):
        told[int(arrays["command_subtask"][k])].append(
            DriveCommand(
                path=arrays["command_path"][end - arrays["command_rows"][k] : end],
                finger_m=float(arrays["command_finger_m"][k]),
                speed=float(arrays["command_speed"][k]),
                followed=int(arrays["command_followed"][k]),
                stopped=bool(arrays["command_stopped"][k]),
                held=int(arrays["command_held"][k]),
            )
        )
    return tuple(tuple(given) for given in told)


def _command_columns(told: Sequence[Sequence[DriveCommand]]) -> dict[str, NDArray]:
    flat = [command for given in told for command in given]
    paths = [command.path for command in flat]
    return {
        "command_subtask": np.array([index for index, given in enumerate(told) for _ in given], np.int32),
        "command_rows": np.array([len(path) for path in paths], np.int32),
        "command_path": np.concatenate(paths) if paths else np.zeros((0, 10)),
        "command_finger_m": np.array([command.finger_m for command in flat], float),
        "command_speed": np.array([command.speed for command in flat], float),
        "command_followed": np.array([command.followed for command in flat], np.int32),
        "command_stopped": np.array([command.stopped for command in flat], np.uint8),
        "command_held": np.array([command.held for command in flat], np.int32),
    }


def _stacked(poses: list[NDArray], count: int, width: int) -> NDArray:
    return np.stack(poses, axis=1) if poses else np.zeros((count, 0, width), np.float32)


def _flat(joints: list[NDArray], count: int) -> NDArray:
    return np.concatenate(joints, axis=1) if joints else np.zeros((count, 0), np.float32)
