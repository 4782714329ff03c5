"""Faults as they are typed: what they stand for, and what is said of those that nobody can make."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executor.cli.faults import BadFault, FaultOption
from executor.sim.faults import KINDS, BlockedDoor, Fault, NavigationOffset, PoseError, WeakGrip, WrongScale, fault_json

METRES = st.floats(-0.5, 0.5, allow_nan=False).map(lambda value: round(value, 4))
IDS = st.from_regex(r"[a-z]{1,8}_[0-9]", fullmatch=True)
FAULTS: st.SearchStrategy[Fault] = st.one_of(
    st.builds(PoseError, IDS, METRES, METRES),
    st.builds(NavigationOffset, METRES, METRES, st.floats(-30, 30)),
    st.builds(WrongScale, IDS, st.floats(0.1, 3.0)),
    st.builds(BlockedDoor, IDS, st.floats(0.05, 1.0)),
    st.builds(WeakGrip, st.floats(0.1, 30.0)),
)


@given(FAULTS, st.integers(0, 100))
def test_a_fault_that_is_typed_is_that_fault(fault: Fault, seed: int) -> None:
    values = fault_json(fault)
    kind, object_id = values.pop("kind"), values.pop("object_id", None)
    numbers = [f"{name}={value!r}" for name, value in values.items()]
    words = FaultOption.parse(f"{kind}:{','.join([*([str(object_id)] if object_id else []), *numbers])}")
    assert words.drawn(seed) == fault


@pytest.mark.parametrize("text", ["pose:glass_0,size_m=0.02", "navigation:size_m=0.02"])
def test_a_seed_draws_the_direction(text: str) -> None:
    words = FaultOption.parse(text)
    assert words.drawn(1) == words.drawn(1) != words.drawn(2)
    values = fault_json(words.drawn(1))
    size = np.hypot(*(float(str(v)) for k, v in values.items() if k.endswith("_m")))
    assert size == pytest.approx(0.02, abs=1e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("pos:glass_0,size_m=0.02", "did you mean pose?"),
        ("", "there is no kind ''"),
        ("pose:size_m=0.02", "it is about an object, such as glass_0"),
        ("pose:glass_0", "it needs dx_m and dy_m"),
        ("scale:glass_0", "it needs factor"),
        ("scale:glass_0,factor=0", "multiplied by more than 0"),
        ("grip:", "it needs force_n"),
        ("grip:force_n=-1", "more than 0 N"),
        ("grip:force_n=strong", "force_n is a number, not 'strong'"),
        ("grip:force_n=nan", "force_n is a number of"),
        ("grip:glass_0,force_n=1", "'glass_0' is not one of its numbers"),
        ("door:refrigerator_0,fraction=2", "between 0 and 1 of its range"),
        ("pose:glass_0,size_m=0.1,dx_m=0.2", "give it alone"),
        ("navigation:left=1", "which are forward_m, left_m, yaw_deg"),
    ],
)
def test_what_nobody_can_make_is_said_with_the_forms(text: str, said: str) -> None:
    with pytest.raises(BadFault) as caught:
        FaultOption.parse(text)
    assert said in str(caught.value) and "faults are pose:OBJECT" in str(caught.value)


def test_every_kind_has_a_word() -> None:
    assert set(KINDS.values()) == {PoseError, NavigationOffset, WrongScale, BlockedDoor, WeakGrip}
