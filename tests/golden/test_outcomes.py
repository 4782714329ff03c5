"""This version does what the frozen one did: `make golden` compares all of it, `make test` the quick parts.

`REWRITE_GOLDEN=1 make golden` freezes what is; the difference in tests/golden/frozen/ then says what has changed.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from tests.golden.outcomes import QUICK, WHOLE, Items, machine

FROZEN = Path(__file__).parent / "frozen"


def compare(name: str, items: Items) -> None:
    """Hold items against the frozen ones, or freeze them."""
    path = FROZEN / f"{name}.json"
    now: dict[str, Any] = {
        "machine": machine() if any(item.exact is not None for item in items.values()) else {},
        "rough": {key: item.rough for key, item in items.items()},
        "exact": {key: item.exact for key, item in items.items() if item.exact is not None},
    }
    if os.environ.get("REWRITE_GOLDEN") == "1":
        FROZEN.mkdir(exist_ok=True)
        path.write_text(json.dumps(now, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        return
    assert path.is_file(), f"{name} was never frozen: REWRITE_GOLDEN=1 make golden"
    then = json.loads(path.read_text(encoding="utf-8"))
    assert now["rough"] == then["rough"]
    if now["machine"] == then["machine"]:
        assert now["exact"] == then["exact"]


@pytest.mark.parametrize("name", QUICK)
def test_quick_outcomes_are_the_frozen_ones(name: str, tmp_path: Path) -> None:
    compare(name, QUICK[name](tmp_path))


@pytest.mark.golden
@pytest.mark.parametrize("name", WHOLE)
def test_outcomes_are_the_frozen_ones(name: str, tmp_path: Path) -> None:
    compare(name, WHOLE[name](tmp_path))
