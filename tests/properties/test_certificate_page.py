"""The checker on one page, which shares no code with the package: it confirms what is so, and no forged proof."""

from __future__ import annotations

import ast
import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from tests.forgeries import claim_holds, forgeries, rehashed
from tests.oag.paper import NAMES, task_json, verify
from tests.properties import formulas
from tests.properties.plans import FACTS, Case, cases
from tests.properties.test_certificates import certificate_of

PAGE = Path(__file__).resolve().parents[2] / "scripts" / "check_certificate.py"
FEW = settings(max_examples=60, deadline=None)
MANY = settings(max_examples=2000, deadline=None)

_spec = importlib.util.spec_from_file_location("check_certificate", PAGE)
assert _spec is not None and _spec.loader is not None
page: Any = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(page)


def stands(data: dict[str, Any]) -> bool | None:
    """Whether the page confirms a certificate; None for what it does not read."""
    try:
        page.check(data)
    except page.Rejected as reason:
        event(str(reason)[:20])
        return False
    except NotImplementedError:
        return None
    except (TypeError, KeyError, IndexError, ValueError, AttributeError):
        return False
    return True


def check_forgery(case: Case, data: st.DataObject) -> None:
    """No proof that the page confirms is false, by simulation of every complete start."""
    forged = data.draw(forgeries(certificate_of(case.task())))
    forged = rehashed(forged | {"verdict": "PROVED", "failure": None, "cases": []})
    if stands(forged):
        event("confirmed")
        assert claim_holds(forged | {"counterexample": None, "search": None}, FACTS) is not False


def test_it_shares_no_code() -> None:
    nodes = list(ast.walk(ast.parse(PAGE.read_text(encoding="utf-8"))))
    imported = {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    named = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    assert {str(name).split(".")[0] for name in imported | named} <= sys.stdlib_module_names


@pytest.mark.parametrize("name", NAMES)
def test_the_papers_tasks_stand(name: str, tmp_path: Path) -> None:
    made = verify(task_json(name), name).certificate
    assert made is not None
    file = tmp_path / "certificate.json"
    file.write_text(json.dumps(made.to_json()), encoding="utf-8")
    # Away from the checkout and without its site packages: there is nothing that it could share.
    command = [sys.executable, "-I", "-S", str(PAGE), str(file)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "") and done.stdout.startswith("stands: everything that")
    file.write_text(json.dumps(rehashed(made.to_json() | {"verdict": "REFUTED", "failure": ["init", 0, -1]})))
    assert subprocess.run(command, capture_output=True, timeout=60, check=False).returncode != 0


@given(cases())
@FEW
def test_what_was_made_stands(case: Case) -> None:
    data = certificate_of(case.task())
    event(data["verdict"])
    assert stands(data) is not False


@pytest.mark.slow
@given(cases())
@MANY
def test_what_was_made_stands_at_length(case: Case) -> None:
    assert stands(certificate_of(case.task())) is not False


@given(formulas.formula_cases())
@FEW
def test_what_was_made_of_formulas_stands(case: formulas.FormulaCase) -> None:
    assert stands(certificate_of(case.task())) is not False


@given(cases(most_unknown=4), st.data())
@FEW
def test_a_forged_proof_does_not_stand(case: Case, data: st.DataObject) -> None:
    check_forgery(case, data)


@pytest.mark.slow
@given(cases(most_unknown=4), st.data())
@MANY
def test_a_forged_proof_does_not_stand_at_length(case: Case, data: st.DataObject) -> None:
    check_forgery(case, data)
