"""Samples of an episode as one compressed file, `samples.xz`.

The first line is JSON and names the arrays: `{"robot_qpos": ["<f4", [600, 12]], ...}`. Their bytes follow in that
order, each array as [column, byte, row]. Neighbours in time are adjacent, and values that the physics state and a
column share are stored once. A demonstration of a minute takes 130 kB, half of a compressed archive of the same arrays.
Reading executes nothing.
"""

from __future__ import annotations

import io
import json
import lzma
import math
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from executor.records import DriveCommand, Rollout, Trajectory

Arrays = Mapping[str, NDArray]

MOST_BYTES = 128_000_000
"""Maximum size of a file's arrays; a demonstration of a minute takes 1.5 MB at 10 samples per second."""
MOST_SUBTASKS = 10_000
_LONGEST_HEADER = 1 << 16
_AT_ONCE_BYTES = 1 << 20
_READ_BYTES = 1 << 16
_FOOTER_BYTES = 12
_DECODER_BYTES = 64_000_000  # Memory limit of the decoder; files of this program need 1 MB.
# Context and position do not predict a byte. A higher preset takes five times the time for 2 %.
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 1, "lc": 0, "pb": 0}]
_KINDS = frozenset({"<f4", "<f8", "<i4", "|u1", "|b1"})


class BadSamples(ValueError):
    """A file is no complete file of samples."""


def packed(arrays: Arrays) -> bytes:
    """Pack arrays into the content of a file of samples.

    Raises:
        BadSamples: They exceed the limit of a file.
        TypeError: One has a dtype that is not supported.
    """
    size = sum(array.nbytes for array in arrays.values())
    if size > MOST_BYTES:
        raise BadSamples(f"{_too_much(size)}; record fewer samples a second")
    header = {name: (array.dtype.str, array.shape) for name, array in arrays.items()}
    if unknown := sorted({kind for kind, _ in header.values()} - _KINDS):
        raise TypeError(f"arrays of {', '.join(unknown)} are not kept; {', '.join(sorted(_KINDS))} are")
    parts = [json.dumps(header).encode() + b"\n", *(_planes(array) for array in arrays.values())]
    return lzma.compress(b"".join(parts), filters=_FILTERS)


def unpacked(content: bytes | BinaryIO) -> dict[str, NDArray]:
    """Unpack the arrays of a file of samples; no more is decompressed than its header announces.

    Args:
        content: The file, or its content.

    Raises:
        BadSamples: It is no such file, or too large.
    """
    raw = _Unpacked(io.BytesIO(content) if isinstance(content, bytes) else content)
    found = {}
    try:
        kinds = _header(raw.line(_LONGEST_HEADER))
        if (size := sum(dtype.itemsize * math.prod(shape) for dtype, shape in kinds.values())) > MOST_BYTES:
            raise BadSamples(_too_much(size))
        for name, (dtype, shape) in kinds.items():
            found[name] = _rows(raw, dtype, shape)
        if raw.read(1) or not raw.whole:
            raise BadSamples("not a whole file of samples")
    except (lzma.LZMAError, ValueError, TypeError, AttributeError, RecursionError, EOFError) as problem:
        raise problem if isinstance(problem, BadSamples) else BadSamples(f"not a file of samples: {problem}") from None
    return found


def _header(line: bytes) -> dict[str, tuple[np.dtype, tuple[int, ...]]]:
    """Parse the first line of a file: name -> dtype and shape.

    Raises:
        BadSamples, ValueError, TypeError, AttributeError, RecursionError: It is no such header.
    """
    found = {}
    for name, (kind, shape) in json.loads(line).items():
        if kind not in _KINDS or any(type(side) is not int or side < 0 for side in shape):
            raise BadSamples(f"{name} is of no known kind")
        found[str(name)] = np.dtype(kind), tuple(shape)
    return found


def _too_much(size: int) -> str:
    return f"its arrays take {size // 1_000_000} MB, more than the {MOST_BYTES // 1_000_000} MB that a file may have"


class _Unpacked:
    """A compressed file, decompressed piece by piece.

    Args:
        packed: The file.
    """

    def __init__(self, packed: BinaryIO) -> None:
        self._packed = packed
        self._reader = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=_DECODER_BYTES)
        self._waiting = b""

    @property
    def whole(self) -> bool:
        """Whether everything has been read, including the checksum."""
        return self._reader.eof and not self._waiting

    def line(self, most: int) -> bytes:
        """Read up to the first end of a line.

        Raises:
            BadSamples: There is none in that many bytes.
        """
        line, end, self._waiting = self.read(most).partition(b"\n")
        if not end:
            raise BadSamples("not a whole file of samples: its header does not end")
        return line

    def read(self, count: int) -> bytes:
        """Read that many bytes, or fewer at the end.

        Raises:
            LZMAError: It was not packed by this program.
        """
        parts, self._waiting = [self._waiting[:count]], self._waiting[count:]
        left = count - len(parts[0])
        while left and not self._reader.eof:
            more = self._packed.read(_READ_BYTES) if self._reader.needs_input else b""
            if self._reader.needs_input and not more:
                break
            parts.append(self._reader.decompress(more, max_length=left))
            left -= len(parts[-1])
        return b"".join(parts)


def is_whole(path: Path) -> bool:
    """Decide by its last bytes whether a file of samples was cut off; xz ends with a checksum and its mark."""
    with path.open("rb") as stream:
        stream.seek(max(stream.seek(0, io.SEEK_END) - _FOOTER_BYTES, 0))
        footer = stream.read()
    return len(footer) == _FOOTER_BYTES and footer[:4] == zlib.crc32(footer[4:10]).to_bytes(4, "little")


def shapes(begin: bytes) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the arrays of a file of samples, from its first bytes.

    Raises:
        BadSamples: It is no such file.
    """
    try:
        kinds = _header(_Unpacked(io.BytesIO(begin)).line(_LONGEST_HEADER))
    except (lzma.LZMAError, ValueError, TypeError, AttributeError, RecursionError, EOFError) as problem:
        raise problem if isinstance(problem, BadSamples) else BadSamples(f"not a file of samples: {problem}") from None
    return {name: shape for name, (_, shape) in kinds.items()}


def _planes(array: NDArray) -> bytes:
    rows = len(array) if array.ndim else 1
    flat = np.ascontiguousarray(array).reshape(rows, -1).view(np.uint8) if array.size else np.zeros((0, 0), np.uint8)
    return flat.reshape(rows, -1, array.dtype.itemsize).transpose(1, 2, 0).tobytes() if array.size else b""


def _rows(raw: _Unpacked, dtype: np.dtype, shape: tuple[int, ...]) -> NDArray:
    """Read the next array, some byte planes at a time.

    Raises:
        BadSamples: The file is too short.
    """
    found = np.empty(shape, dtype)
    if not found.size:
        return found
    rows = shape[0] if shape else 1
    planes = found.reshape(rows, -1).view(np.uint8)
    count = planes.shape[1]
    for first in range(0, count, max(_AT_ONCE_BYTES // rows, 1)):
        end = min(first + max(_AT_ONCE_BYTES // rows, 1), count)
        content = raw.read((end - first) * rows)
        if len(content) < (end - first) * rows:
            raise BadSamples("not a whole file of samples")
        planes[:, first:end] = np.frombuffer(content, np.uint8).reshape(end - first, rows).T
    return found


def columns(rollout: Rollout) -> dict[str, NDArray]:
    """Return all arrays that are kept of a rollout; `docs/datasets.md` documents each.

    Args:
        rollout: The recording, with at least one sample.
    """
    return motion_columns(rollout.trajectory, [record.commands for record in rollout.subtasks])


def motion_columns(motion: Trajectory, commands_by_subtask: Sequence[Sequence[DriveCommand]]) -> dict[str, NDArray]:
    """Return a recorded motion as arrays, with the drive commands subtask by subtask."""
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
        **_command_columns(commands_by_subtask),
    }


def commands(arrays: Arrays) -> tuple[tuple[DriveCommand, ...], ...]:
    """Return the drive commands, subtask by subtask, from the arrays of `columns`.

    Raises:
        BadSamples: The arrays contradict each other.
    """
    rows, subtasks = arrays["command_rows"], arrays["command_subtask"]
    fits = len(rows) == len(subtasks) and rows.sum(dtype=np.int64) == len(arrays["command_path"])
    if not fits or (rows < 0).any() or (subtasks < 0).any() or subtasks.max(initial=0) >= MOST_SUBTASKS:
        raise BadSamples("its commands do not belong together")
    ends = np.cumsum(rows)
    commands_by_subtask: list[list[DriveCommand]] = [
        [] for _ in range(int(arrays["command_subtask"].max(initial=-1)) + 1)
    ]
    for k, end in enumerate(ends):
        commands_by_subtask[int(arrays["command_subtask"][k])].append(
            DriveCommand(
                path=arrays["command_path"][end - arrays["command_rows"][k] : end],
                finger_m=float(arrays["command_finger_m"][k]),
                speed=float(arrays["command_speed"][k]),
                followed=int(arrays["command_followed"][k]),
                stopped=bool(arrays["command_stopped"][k]),
                held=int(arrays["command_held"][k]),
            )
        )
    return tuple(tuple(one_subtask) for one_subtask in commands_by_subtask)


def _command_columns(commands_by_subtask: Sequence[Sequence[DriveCommand]]) -> dict[str, NDArray]:
    flat = [command for one_subtask in commands_by_subtask for command in one_subtask]
    paths = [command.path for command in flat]
    return {
        "command_subtask": np.array(
            [index for index, one_subtask in enumerate(commands_by_subtask) for _ in one_subtask], np.int32
        ),
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
