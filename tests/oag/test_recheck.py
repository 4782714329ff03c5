"""The certificate checker: small, independent, and not to be fooled by hand-made changes."""

from __future__ import annotations

import ast
import copy
import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

import oag
from tests.oag.paper import NAMES, invalid, task_json, verify

SOURCE = Path(__file__).parent.parent.parent / "oag" / "recheck.py"


def certificate(name: str = "T1") -> dict[str, Any]:
    """A task's certificate as JSON."""
    made = verify(task_json(name), name).certificate
    assert made is not None
    data: dict[str, Any] = json.loads(json.dumps(made.to_json()))
    return data


def rehash(data: dict[str, Any]) -> dict[str, Any]:
    """Makes the hashes right again."""
    for key, part in (("task_hash", "plan"), ("scene_sha", "scene")):
        text = json.dumps(data[part], sort_keys=True, separators=(",", ":"))
        data[key] = hashlib.sha256(text.encode()).hexdigest()
    return data


def test_it_is_short_and_imports_the_table_only() -> None:
    text = SOURCE.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 150
    imported = {node.module for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom) and node.module}
    assert {name for name in imported if name.startswith("oag")} == {"oag.facts", "oag.library", "oag.primitives"}


@pytest.mark.parametrize("name", NAMES)
def test_certificates_pass(name: str) -> None:
    assert oag.recheck(certificate(name))


def test_a_dropped_link_is_noticed() -> None:
    data = certificate()
    for index in range(len(data["links"])):
        less = copy.deepcopy(data)
        del less["links"][index]
        assert not oag.recheck(less)


def test_a_moved_producer_is_noticed() -> None:
    data = certificate()
    for link in data["links"]:
        link[-1] += 2
        assert "is written at" in oag.recheck(data).reason
        link[-1] -= 2


def test_what_is_known_cannot_be_assumed_away() -> None:
    report = invalid("dropped_open")
    assert report.certificate is not None
    data = json.loads(json.dumps(report.certificate.to_json()))
    data["assumptions"].append({"kind": "assumed", "time": 1, "fact": ["open", "refrigerator_0"], "value": True})
    assert oag.recheck(data).reason == "('open', 'refrigerator_0') is assumed though it is known"


def test_a_dropped_reset_is_noticed() -> None:
    data = certificate()
    data["assumptions"] = data["assumptions"][1:]
    assert "near" in oag.recheck(data).reason


def test_the_reset_supplies_nothing_else() -> None:
    data = certificate()
    data["assumptions"].append({"kind": "reset", "fact": ["hot", "glass_0"], "value": True})
    assert oag.recheck(data).reason == "the reset does not supply ('hot', 'glass_0')"


def test_a_changed_plan_is_noticed_by_its_hash_and_by_its_links() -> None:
    data = certificate()
    data["plan"]["subtasks"].pop()
    assert oag.recheck(data).reason == "task_hash is of something else"
    assert not oag.recheck(rehash(data))


def test_a_refutation_cannot_be_sold_as_a_proof() -> None:
    report = invalid("dropped_open")
    assert report.certificate is not None
    data = json.loads(json.dumps(report.certificate.to_json()))
    data["verdict"] = "PROVED"
    assert oag.recheck(data).reason == "the evidence is for REFUTED, the verdict says PROVED"
    data["failure"] = None
    assert not oag.recheck(data)


def test_another_table_of_primitives_is_noticed() -> None:
    data = certificate()
    data["library_sha"] = "0" * 64
    assert oag.recheck(data).reason == "it was made with another table of primitives"


@pytest.mark.parametrize("junk", [{}, {"plan": 1}, [], None, 3, "certificate"])
def test_junk_is_rejected_not_raised(junk: Any) -> None:
    result = oag.recheck(junk)
    assert not result
    assert result.reason.startswith("malformed certificate")
