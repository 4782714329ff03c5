"""A foreign `bddl` package ends in one clear sentence; importing oag stays light."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from oag.model import require_own_language

ROOT = Path(__file__).parent.parent.parent


def test_a_foreign_package_is_refused() -> None:
    foreign = ModuleType("bddl")
    foreign.__file__ = "/somewhere/site-packages/bddl/__init__.py"
    with pytest.raises(ImportError) as caught:
        require_own_language(foreign)
    assert "found another one at /somewhere/site-packages/bddl/__init__.py" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_importing_oag_beside_a_foreign_package_says_so(tmp_path: Path) -> None:
    """As in an environment in which PyPI's `bddl` comes first: no AttributeError from somewhere inside."""
    package = tmp_path / "bddl"
    package.mkdir()
    (package / "__init__.py").write_text("version = '3.6.0'\n", encoding="utf-8")
    code = f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(ROOT)!r}]; import oag"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert done.returncode != 0
    assert done.stderr.strip().splitlines()[-1].startswith("ImportError: oag needs Scene2Demo's own `bddl` package")


def test_importing_oag_loads_neither_networkx_nor_pydantic() -> None:
    code = "import oag, sys; print([m for m in ('networkx', 'pydantic', 'z3', 'numpy') if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=600, check=True
    )
    assert done.stdout.strip() == "[]"
