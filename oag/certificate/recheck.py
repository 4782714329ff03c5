"""Recheck of a certificate: the independent check, and a comparison with a given task and scene.

The independent check alone (`oag.certificate.check`) decides about the verdict. What a certificate repeats of its plan
and of the start knowledge is compared with the task and the scene.

Source: docs/semantics.md, Certificates; `oag/certificate/certificate.schema.json` has the form.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import bddl
from oag.certificate.check import RecheckResult, certificate_in
from oag.certificate.check import recheck as check
from oag.certificate.check_plan import Rejected, domain_of
from oag.model.actions import flow_to_json
from oag.model.codec import Source, shown
from oag.model.domain import Domain
from oag.model.scene import RobotPose, Scene
from oag.model.symbols import Kind
from oag.primitives.state import scene_facts
from oag.primitives.table import library_sha
from oag.task_definition import Task
from oag.wellformed import check as form_of


def digest(value: object) -> str:
    """Return the SHA-256 of a JSON value's canonical text."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def condition_json(formula: bddl.Formula) -> list[object] | str:
    """Return a condition as certificates have it: [atom, value] for each literal, else the formula's text.

    Example:
        >>> import bddl
        >>> condition_json(bddl.parse_formula("(not (open box_0))"))
        [[['open', 'box_0'], False]]
    """
    literals = bddl.literals(formula)
    if literals is None:
        return bddl.format(formula)
    return [[[literal.atom.predicate, *literal.atom.args], literal.value] for literal in literals]


def plan_json(task: Task) -> dict[str, object]:
    """Return the part of a plan that a certificate repeats: roles, conditions, flows, and the task goal."""
    return {
        "goal": condition_json(task.goal),
        "goal_given": task.goal_given,
        "subtasks": [
            {
                "target": subtask.target,
                "support_goal": subtask.support_goal,
                "init": condition_json(subtask.init),
                "goal": condition_json(subtask.goal),
                "flow": None if subtask.flow is None else flow_to_json(subtask.flow),
            }
            for subtask in task.subtasks
        ],
    }


def scene_json(scene: Scene) -> dict[str, object]:
    """Return the part of a scene that a certificate repeats: categories, items, articulated fixtures, and the start.

    What geometry found impossible is in it where something was.
    """
    kinds = {key: thing.kind for key, thing in scene.objects.items()}
    known = [{**each.to_json(), "given": condition_json(bddl.And(each.given))} for each in scene.known]
    return {
        **({"known": known} if known else {}),
        "objects": scene.categories,
        "items": [key for key, kind in kinds.items() if kind is Kind.ITEM],
        "articulated": [key for key, kind in kinds.items() if kind is Kind.ARTICULATED],
        "start": [[list(fact), value] for fact, value in scene_facts(scene)],
    }


def recheck(
    certificate: Any,
    task: Task | Source | None = None,
    scene: Scene | Source | None = None,
    domain: Domain | None = None,
) -> RecheckResult:
    """Decide whether a certificate bears out its verdict, and if asked, whether it is about a task, scene and domain.

    Args:
        certificate: A `Certificate`, its JSON mapping, a `Report` or the JSON of one; a malformed one is rejected.
        task: The task that it has to be about, or its file. A flow that it omits may be any flow in the certificate.
        scene: The scene that it has to be about, or its file; by default the one that the task carries, if any.
        domain: The domain that it has to be in; by default the scene's, if there is one.

    Example:
        >>> import oag
        >>> scene = oag.Scene.from_json({"objects": {"box_0": {"category": "drawer", "bbox_extent": [1, 1, 1]}}})
        >>> report = oag.compose(oag.Task.from_json({"sub_tasks": []}, scene=scene)).verify()
        >>> bool(oag.recheck(report.certificate, task=report.task))
        True
    """
    chosen = None if scene is None else scene if isinstance(scene, Scene) else Scene.from_json(scene)
    asked = None if task is None else task if isinstance(task, Task) else Task.from_json(task, scene=chosen)
    place = chosen if chosen is not None or asked is None else asked.scene
    result = check(certificate)
    if not result:
        return result
    try:
        data = certificate_in(certificate)
    except Rejected as problem:
        return RecheckResult(False, str(problem))
    if task is not None and place is None and not isinstance(task, Task) and "domain" in data:
        # Its formulas and flows are in the certificate's domain.
        empty = Scene("(certificate)", RobotPose(), {}, domain=domain_of(data))
        asked = replace(Task.from_json(task, scene=empty), scene=None)
    difference = _other_task(data["plan"], asked)
    if place is not None and not difference:
        difference = _difference("scene", scene_json(place), data["scene"])
        difference = difference or _other_domain(data, place.domain)
        # Certificates do not contain sizes, for example.
        malformed = form_of(asked, place) if asked is not None and not difference else ()
        if malformed:
            difference = f"the task is not well formed in this scene: {malformed[0].brief}"
    if domain is not None and not difference:
        difference = _other_domain(data, domain)
    return RecheckResult(False, difference) if difference else result


def _other_domain(data: Mapping[str, Any], domain: Domain) -> str:
    if (domain.built_in and "domain" not in data) or data["library_sha"] == library_sha(domain):
        return ""
    theirs = domain_of(data)
    return f"it is about another domain than {domain.name_apart_from(theirs)}: {theirs.name_apart_from(domain)}"


def _other_task(plan: Mapping[str, Any], task: Task | None) -> str:
    if task is None:
        return ""
    own: Any = plan_json(task)
    if len(own["subtasks"]) == len(plan["subtasks"]):
        for mine, theirs in zip(own["subtasks"], plan["subtasks"], strict=True):
            mine["flow"] = theirs["flow"] if mine["flow"] is None else mine["flow"]
    return _difference("task", own, plan)


def _difference(what: str, mine: object, theirs: object) -> str:
    """Return the first place in which two JSON values differ, in words, "" when they are equal."""
    if digest(mine) == digest(theirs):
        return ""
    place, one, other = next(_differences(_plain(mine), _plain(theirs), ""))
    return f"it is about another {what}: {place} is {shown(other)} there, and {shown(one)} here"


def _differences(mine: Any, theirs: Any, place: str) -> Iterator[tuple[str, object, object]]:
    if type(mine) is type(theirs) is dict and mine.keys() == theirs.keys():
        for key in mine:
            yield from _differences(mine[key], theirs[key], f"{place}.{key}" if place else key)
    elif type(mine) is type(theirs) is list and len(mine) == len(theirs):
        for index, (one, other) in enumerate(zip(mine, theirs, strict=True)):
            yield from _differences(one, other, f"{place}[{index}]")
    elif digest(mine) != digest(theirs):
        yield place, mine, theirs


def _plain(value: object) -> Any:
    return json.loads(json.dumps(value))
