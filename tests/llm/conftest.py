"""No test of this package reaches a real provider, whatever the environment holds."""

from __future__ import annotations

import pytest

from llm.client.profiles import tables


@pytest.fixture(autouse=True)
def no_provider(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take away keys, addresses and proxies."""
    monkeypatch.delenv("SCENE2DEMO_PROFILES", raising=False)
    for table in tables().values():
        for name in ("key_variable", "base_url_variable"):
            if name in table:
                monkeypatch.delenv(table[name], raising=False)
    monkeypatch.setenv("NO_PROXY", "*")
