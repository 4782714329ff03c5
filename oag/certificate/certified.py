"""Whether a certificate bears out its verdict, and whether that is about this task and this scene.

The independent check alone (`oag.checker`) decides about the verdict. What a task and a scene say is compared with what
the certificate repeats of its own.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from oag.certificate.contents import digest, plan_json, scene_json
from oag.checker.cases import Rejected
from oag.checker.recheck import RecheckResult, certificate_in
from oag.checker.recheck import recheck as check
from oag.model.jsonfile import Source, shown
from oag.model.scene import Scene
from oag.task.task import Task
from oag.task.wellformed import check as form_of


def recheck(certificate: Any, task: Task | Source | None = None, scene: Scene | Source | None = None) -> RecheckResult:
    """Decides whether a certificate bears out its verdict, and if asked, whether it is about a task and a scene.

    Args:
        certificate: A `Certificate`, its JSON mapping, a `Report` or the JSON of one; a malformed one is rejected.
        task: The task that it has to be about, or its file. A flow that it leaves out may be any in the certificate.
        scene: The scene that it has to be about, or its file; by default the one that the task carries, if any.

    Raises:
        TaskError, SceneError: The task or the scene cannot be read.

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
    difference = _other_task(data["plan"], asked)
    if place is not None and not difference:
        difference = _difference("scene", scene_json(place), data["scene"])
        # Sizes, say, are in no certificate.
        malformed = form_of(asked, place) if asked is not None and not difference else ()
        if malformed:
            difference = f"the task is not well formed in this scene: {malformed[0].brief}"
    return RecheckResult(False, difference) if difference else result


def _other_task(plan: Mapping[str, Any], task: Task | None) -> str:
    """Returns what a certificate's plan has otherwise than a task, "" when nothing."""
    if task is None:
        return ""
    own: Any = plan_json(task)
    if len(own["subtasks"]) == len(plan["subtasks"]):
        for mine, theirs in zip(own["subtasks"], plan["subtasks"], strict=True):
            mine["flow"] = theirs["flow"] if mine["flow"] is None else mine["flow"]
    return _difference("task", own, plan)


def _difference(what: str, mine: object, theirs: object) -> str:
    """Returns the first place in which two JSON values differ, in words, "" when they are equal."""
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
