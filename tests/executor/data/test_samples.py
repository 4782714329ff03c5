"""Files of samples: what goes in comes out, to the bit, and nothing else is taken for one."""

from __future__ import annotations

import lzma

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from executor.data import samples
from executor.records import DriveCommand

KINDS = st.sampled_from(["<f4", "<f8", "<i4", "|u1"]).map(np.dtype)
ARRAYS = KINDS.flatmap(lambda kind: arrays_of.arrays(kind, arrays_of.array_shapes(min_dims=1, max_dims=3, min_side=0)))


@given(st.dictionaries(st.text(max_size=8), ARRAYS, max_size=5))
def test_what_is_packed_comes_out_as_it_was(given_arrays: dict[str, np.ndarray]) -> None:
    found = samples.unpacked(samples.packed(given_arrays))
    assert list(found) == list(given_arrays)
    for name, array in given_arrays.items():
        assert found[name].dtype == array.dtype and found[name].shape == array.shape
        assert found[name].tobytes() == np.ascontiguousarray(array).tobytes()


def test_what_a_robot_was_told_comes_out_as_it_was() -> None:
    told = (
        (DriveCommand(np.full((1, 10), 0.5), 0.028, held=125),),
        (
            DriveCommand(np.linspace(0, 1, 30).reshape(3, 10), 0.01, 0.6, 17, stopped=True, held=38),
            DriveCommand(np.zeros((2, 10)), 0.0, 1.0, 40),
        ),
    )
    found = samples.commands(samples.unpacked(samples.packed(samples._command_columns(told))))
    assert [len(given_commands) for given_commands in found] == [1, 2]
    for ours, theirs in zip(sum(told, ()), sum(found, ()), strict=True):
        assert np.array_equal(ours.path, theirs.path)
        assert (ours.finger_m, ours.speed, ours.followed, ours.stopped, ours.held) == (
            theirs.finger_m,
            theirs.speed,
            theirs.followed,
            theirs.stopped,
            theirs.held,
        )


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"not compressed",
        lzma.compress(b"no header"),
        lzma.compress(b'{"a": ["|O", [1]]}\n12345678'),
        lzma.compress(b'{"a": ["<f4", [-1]]}\n'),
        lzma.compress(b'{"a": ["<f4", [2]]}\n1234'),
        lzma.compress(b'{"a": ["<f4", [1]]}\n12345678'),
        lzma.compress(b'["<f4"]\n'),
        samples.packed({"a": np.arange(5.0)})[:-9],
    ],
)
def test_anything_else_is_refused(content: bytes) -> None:
    with pytest.raises(samples.BadSamples):
        samples.unpacked(content)


def test_arrays_that_could_be_anything_are_not_kept() -> None:
    with pytest.raises(TypeError, match="not kept"):
        samples.packed({"a": np.array([object()])})
