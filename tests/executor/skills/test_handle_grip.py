"""When a handle is still held: pulled along the way the fingers close, it hangs on one of them."""

from __future__ import annotations

import pytest

from tests.executor.wishes import pursued


@pytest.mark.parametrize(
    "seed", [pytest.param(90030, id="a microwave"), pytest.param(90019, id="a refrigerator", marks=pytest.mark.slow)]
)
def test_a_door_that_is_pulled_along_the_closing_of_the_fingers_opens(seed: int) -> None:
    done = pursued(seed)
    assert done.succeeded, done.failure
