"""`scene2demo graph`: write the object-action graph of a task as a picture, or for other tools."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from executor.cli.command_options import GraphOptions
from executor.cli.errors import DONE, BadOption
from executor.cli.inputs import refuse_existing, task_and_scene
from executor.cli.output import print_text, tell
from executor.reports.graph_picture import graph_file
from executor.system.files import json_text, write_text
from oag import ObjectActionGraph, compose, to_dot, to_drawing, to_graphml, to_mermaid


def execute(options: GraphOptions) -> int:
    """Write the graph in one format, to a file or to standard output; a wrong plan has a graph, too.

    Raises:
        BadOption: When neither `--format` nor the file's ending determines the format.
    """
    form = _format(options)
    task, scene = task_and_scene(options.task, options.scene)
    written = _WRITERS[form](compose(task, scene=scene))
    if options.out is None:
        print_text(written)
        return DONE
    refuse_existing(options.out, force=options.force)
    write_text(options.out, written)
    tell(f"written: {options.out}")
    return DONE


def _format(options: GraphOptions) -> str:
    """Return the requested format, by name or by the ending of the file."""
    if options.json:
        return "json"
    if options.format is not None or options.out is None:
        return options.format or "svg"
    form = _ENDINGS.get(options.out.suffix.lower())
    if form is None:
        expected = f"a file that ends in {', '.join(_ENDINGS)}, or --format with what to write"
        raise BadOption("--out", options.out, expected)
    return form


def _as_json(graph: ObjectActionGraph) -> str:
    return json_text(to_drawing(graph)) + "\n"


_ENDINGS = {
    ".svg": "svg",
    ".mmd": "mermaid",
    ".mermaid": "mermaid",
    ".dot": "dot",
    ".gv": "dot",
    ".graphml": "graphml",
    ".json": "json",
}
_WRITERS: Mapping[str, Callable[[ObjectActionGraph], str]] = {
    "svg": graph_file,
    "mermaid": to_mermaid,
    "dot": to_dot,
    "graphml": to_graphml,
    "json": _as_json,
}
