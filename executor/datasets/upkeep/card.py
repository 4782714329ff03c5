"""The page that goes with a data set: what is in it, how it was made, how much of what was tried succeeded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from executor.datasets.store import EpisodeStore
from executor.datasets.upkeep.contents import Contents, contents_of
from oag import clopper_pearson

CARD = "README.md"

_FRONT = """---
license: apache-2.0
task_categories:
- robotics
tags:
- scene2demo
- simulation
- mobile-manipulation
{extra}---
"""
_LEROBOT = "- LeRobot\nconfigs:\n- config_name: default\n  data_files: data/*/*.parquet\n"
_FIELDS = (
    ("observation.state", "20", "m, rad", "12 joints; the hand in the world: x y z, quaternion x y z w; opening"),
    ("observation.velocity", "12", "m/s, rad/s", "of the joints"),
    (
        "observation.environment_state",
        "216",
        "m, rad",
        "12 things and 8 handles in the world, what the task names first",
    ),
    (
        "observation.object_poses",
        "7 M",
        "m",
        "what can be moved, in the world; `object_ids` of the episode has the order",
    ),
    (
        "observation.joint_positions",
        "J",
        "rad or m",
        "of articulated things; `joint_names` of the episode has the order",
    ),
    ("observation.camera_pose_VIEW", "7", "m", "the camera in the world, where pictures were drawn"),
    ("observation.point_cloud", "1024 4", "m", "from the base, and 1 on the hand; where it was asked for"),
    ("action", "10", "m, rad", "hand: 3 of position, 3 of rotation, from the base; gripper; base: 3, in its own axes"),
    ("action.joint_target", "12", "m, rad", "where the joints shall be at the next row"),
    ("subtask_index, primitive_index", "1", "", "what was going on; a primitive's number in flows, 0 for none"),
    ("next.reward, next.done", "1", "", "1 / number of subtasks at the end of each; true in the last row"),
    ("observation.images.VIEW", "H W 3", "RGB", "where pictures were drawn"),
    ("observation.depth.VIEW", "H W", "mm", "along the camera's axis, 0 for nothing; where it was asked for"),
    ("observation.segmentation.VIEW", "H W", "", "number of a body, in the episode's legend; where it was asked for"),
)


def card(text: str, kind: str | None = None) -> str:
    """Returns a data set's card in Markdown: its page, and before it what readers of formats look for.

    Args:
        text: The page, as `page` gives it.
        kind: The format that it was folded into, or None for the store itself.
    """
    tag = "" if kind is None else f"- {kind}\n"
    return (
        _FRONT.format(extra=tag + (_LEROBOT if kind is not None and kind.startswith("lerobot") else "")) + "\n" + text
    )


def page_in(text: str) -> str:
    """Returns the page that a card has; one that somebody wrote anew, as it is."""
    before, end, rest = text.partition("\n---\n\n")
    return rest if end and before.startswith("---\n") else text


def page(store: EpisodeStore) -> str:
    """Returns what a data set's card says, whatever format it is in; nothing of when or where it was made.

    Raises:
        NotADataset: It is no store, or an episode cannot be read.
    """
    found = contents_of(store)
    sections = (
        _summary(found),
        _yields(found),
        _provenance(found),
        _variety(found),
        _sizes(found),
        "## Fields\n\n" + _table(("field", "shape", "unit", "what"), _FIELDS),
    )
    return "\n\n".join(sections) + "\n"


def _summary(found: Contents) -> str:
    simulated_s = sum(part.simulated_s for part in found.parts.values())
    rates = ", ".join(f"{rate:g}" for rate in sorted(found.rates_hz)) or "-"
    scales = " or ".join(f"{scale:g}" for scale in sorted(found.scales)) or "-"
    more = f"{found.repeats} more repeat one of these, state by state, and are left out. " if found.repeats else ""
    words = f"{found.kept} demonstrations, {simulated_s / 60:.1f} minutes of simulated time, {found.samples} samples"
    return (
        "# Demonstrations by Scene2Demo\n\n"
        f"{words} at {rates} Hz. {more}Views: {shares(found.views, found.kept)}. "
        f"A mobile Panda at {scales} of its size, in the SAPIEN simulator. Every plan was proved before anything "
        "moved, and every goal was judged in the physics, everything at rest. One demonstration in ten, chosen by its "
        "id, is for validation; they come last, and none has the states of one for training.\n\nLicence: Apache-2.0."
    )


def _yields(found: Contents) -> str:
    rows = []
    for label, part in sorted(found.parts.items()):
        first, last = part.seeds or (0, 0)
        rows.append((label, part.query, f"{first} to {last}", part.made, part.kept, _share(part.succeeded, part.made)))
    rows.append(("all", "", "", found.made, found.kept, _share(found.succeeded, found.made)))
    head = ("origin", "such as", "seeds", "made", "demonstrations", "succeeded (95 % interval)")
    failures = [(kind, count) for kind, count in sorted(found.failures.items())]
    words = _table(("failure", "episodes"), failures) if failures else "No episode failed."
    return f"## Yield\n\n{_table(head, rows)}\n\n{words}"


def _provenance(found: Contents) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in sorted(found.versions)) or "-"
    return (
        "## How it was made\n\n"
        f"Program: {', '.join(sorted(found.programs)) or '-'} (hash of what decides how an episode goes). "
        f"Libraries: {versions}. Everything follows from the seeds: the same command makes the same episodes."
    )


def _variety(found: Contents) -> str:
    """Returns what differs from one demonstration to the next, as they themselves say what was drawn for them."""
    rows, notes = [], []
    for label, variety in sorted(found.varieties.items()):
        of = variety.count
        rows += [(label, name, f"{len(one.values)} in {of}", one.words) for name, one in variety.varied.items()]
        same = f"the same in all {of}: {', '.join(variety.same) or 'nothing'}" if of > 1 else "one demonstration only"
        notes.append(f"{label}: {same}.")
    table = (
        _table(("origin", "what differs", "different values", "numbers that differ most"), rows) + "\n\n"
        if rows
        else ""
    )
    return f"## What varies\n\n{table}{' '.join(notes) or 'There is no demonstration.'}"


def _sizes(found: Contents) -> str:
    rows = [(name, f"{least:.3g} to {most:.3g}") for name, (least, most) in sorted(found.scaled.items())]
    words = _table(("category", "factor"), rows) if rows else "Nothing was scaled."
    return f"## Sizes that were drawn, or fitted to the gripper\n\n{words}"


def shares(found: Mapping[str, int], of: int) -> str:
    """Returns names in order, with how many have each where not all of them do; "none" for no names."""
    return ", ".join(name if n == of else f"{name} ({n} of {of})" for name, n in sorted(found.items())) or "none"


def _share(good: int, of: int) -> str:
    if not of:
        return "-"
    low, high = clopper_pearson(good, of)
    return f"{100 * good / of:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)
