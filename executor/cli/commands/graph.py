"""`scene2demo graph`: write the object-action graph of a task as a picture, or for other tools."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from executor.cli.errors import DONE, BadOption
from executor.cli.options import CommonOptions, DomainFile, Flag, Maybe, OptionalScene, ReplaceFile, TaskFile
from executor.cli.output import print_text, tell
from executor.system.files import json_text, write_text


@dataclass(frozen=True)
class Options(CommonOptions):
    """Draw the object-action graph of a task, or write it for other tools."""

    task: TaskFile
    scene: OptionalScene = None
    domain: DomainFile = None
    format: Maybe[Literal["svg", "mermaid", "dot", "graphml", "json"]] = None
    """What to write: a picture, or text for Mermaid, Graphviz, graph editors or programs; by default what the ending of
    --out says (.svg .mmd .dot .graphml .json), or a picture."""
    out: Maybe[Path] = None
    """The file to write, its folder made when absent; by default standard output."""
    force: ReplaceFile = False
    json: Flag = field(default=False, kw_only=True)
    """The same as `--format json`."""


def execute(options: Options) -> int:
    """Write the graph in one format, to a file or to standard output; a wrong plan has a graph, too."""
    from executor.cli.inputs import domain_in, refuse_existing, task_and_scene
    from executor.reports.graph_picture import graph_file
    from oag import compose
    from oag.graph import to_dot, to_drawing, to_graphml, to_mermaid

    form = _format(options)
    task, scene = task_and_scene(options.task, options.scene, domain_in(options.domain), is_built=False)
    graph = compose(task, scene=scene)
    if form == "json":
        written = json_text(to_drawing(graph)) + "\n"
    else:
        written = {"svg": graph_file, "mermaid": to_mermaid, "dot": to_dot, "graphml": to_graphml}[form](graph)
    if options.out is None:
        print_text(written)
        return DONE
    refuse_existing(options.out, force=options.force)
    write_text(options.out, written)
    tell(f"written: {options.out}")
    return DONE


def _format(options: Options) -> str:
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


_ENDINGS = {
    ".svg": "svg",
    ".mmd": "mermaid",
    ".mermaid": "mermaid",
    ".dot": "dot",
    ".gv": "dot",
    ".graphml": "graphml",
    ".json": "json",
}
