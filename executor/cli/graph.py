"""`scene2demo graph`: the object-action graph of a task, for other tools or to look at."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from executor.cli.errors import DONE
from executor.cli.inputs import refuse_existing, task_and_scene
from executor.cli.options import Graph
from executor.cli.output import print_text, tell
from executor.files import json_text, write_text
from executor.report.graph_picture import graph_file
from oag import ObjectActionGraph, compose, to_dot, to_drawing, to_graphml, to_mermaid


def execute(options: Graph) -> int:
    """Writes the graph in one format, to a file or to standard output; a wrong plan has a graph, too."""
    task, scene = task_and_scene(options.task, options.scene)
    written = _WRITERS["json" if options.json else options.format](compose(task, scene=scene))
    if options.out is None:
        print_text(written)
        return DONE
    refuse_existing(options.out, force=options.force)
    write_text(options.out, written)
    tell(f"written: {options.out}")
    return DONE


def _as_json(graph: ObjectActionGraph) -> str:
    return json_text(to_drawing(graph)) + "\n"


_WRITERS: Mapping[str, Callable[[ObjectActionGraph], str]] = {
    "svg": graph_file,
    "mermaid": to_mermaid,
    "dot": to_dot,
    "graphml": to_graphml,
    "json": _as_json,
}
