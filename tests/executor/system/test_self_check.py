"""SAPIEN draws with the driver that `activate` chooses."""

from __future__ import annotations

import pytest

from executor.system import doctor


@pytest.mark.slow
@pytest.mark.render
def test_a_box_is_drawn() -> None:
    assert doctor.problem_with("drawing") == ""
