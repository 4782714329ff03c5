"""From the readings of a query to the one request that it expresses in a scene, or to a refusal that says why not."""

from __future__ import annotations

from collections.abc import Sequence

from llm.offline.commands import Reading
from llm.offline.ground import Grounding
from llm.offline.refusal import Refusal
from llm.offline.wishes import Interpretation, interpretation
from llm.request import Request


def interpret(readings: Sequence[Reading], grounding: Grounding) -> Interpretation:
    """Returns the one request that the readings allow in the scene.

    Args:
        readings: At least one.
        grounding: Names the scene's objects.

    Raises:
        Refusal: No reading makes sense (the refusal of the one that got furthest), or several different ones do.
    """
    found: dict[Request, Interpretation] = {}
    refusals: list[Refusal] = []
    for reading in readings:
        try:
            meant = interpretation(reading, grounding)
        except Refusal as refusal:
            refusal.in_vain = any(command.kind in ("bare", "nowhere") for command in reading)
            refusal.understood = refusal.understood or "; ".join(str(command) for command in reading)
            refusals.append(refusal)
        else:
            found.setdefault(meant.request, meant)
    undecided = [refusal for refusal in refusals if refusal.leaves_choice]
    if len(found) == 1 and not undecided:
        return next(iter(found.values()))
    if found and not undecided:
        raise Refusal(
            "ambiguous-reading",
            "it can be read in more than one way",
            instead=tuple(found),
        )
    raise max(undecided or refusals, key=lambda refusal: refusal.progress)
