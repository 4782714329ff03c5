"""`scene2demo bench photo`: reconstructions of real pictures, compared with what people say of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from executor.cli.errors import DONE, check
from executor.cli.options import CommonOptions, Maybe, ResultsFolder, RobotName
from executor.cli.output import OUT, print_json, say, tell
from executor.system.files import write_json


@dataclass(frozen=True)
class Options(CommonOptions):
    """Measure how good reconstructions of real pictures are, and how far sentences come in them.

    Each picture is reconstructed with the boxes and names that a person gave it, and each of its sentences is planned
    and executed in its scene. Goes on where an earlier run with the same folder ended.
    """

    pictures: Path
    """Folder of real pictures, which `python -m benchmarks.pictures.fetch` fills."""
    out: ResultsFolder
    annotations: Path = Path("benchmarks/pictures")
    """Folder with pictures.toml, and annotations/ID.json of each picture."""
    half: Maybe[Literal["tuning", "judging"]] = None
    """One half; by default both."""
    only: Maybe[tuple[str, ...]] = None
    """Ids of some pictures; by default all."""
    limit_s: float = 300.0
    """Most CPU seconds of a picture and its sentences."""
    robot: RobotName = None


def execute(options: Options) -> int:
    """Measure, print the tables, and return 0 when all is measured; what is finished is kept."""
    from executor.bench.photo.picture_score import causes, picture_rows, sections
    from executor.bench.photo.pictures import measure_pictures, read_pictures

    check(1.0 <= options.limit_s <= 1e6, "--limit-s", options.limit_s, "seconds from 1 to 1000000")
    chosen = read_pictures(options.annotations, options.pictures, options.half, options.only or ())
    options.out.mkdir(parents=True, exist_ok=True)
    on_picture = _silent if options.json else _tell_picture
    done = list(measure_pictures(options.out, chosen, on_picture, limit_s=options.limit_s, robot=options.robot or ""))
    parts: dict[str, dict[str, Any]] = {
        name: {"card": dict(picture_rows(some)), **causes(some)} for name, some in sections(done).items()
    }
    write_json(options.out / "summary.json", {"pictures": len(done), "sections": parts})
    if options.json:
        print_json({"ok": True, "sections": parts, "pictures": [one.name for one in chosen]})
        return DONE
    for name, part in parts.items():
        _print_table(name, part["card"])
        for subject, counts in part.items():
            if counts and subject != "card":
                say(f"{subject} that failed: " + "; ".join(f"{count} {cause}" for cause, count in counts.items()))
    return DONE


def _print_table(title: str, rows: Mapping[str, str]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, title=title, title_justify="left", show_header=False)
    for name, value in rows.items():
        table.add_row(escape(name), escape(value))
    OUT.print(table)


def _silent(picture: Mapping[str, Any]) -> None:
    pass


def _tell_picture(picture: Mapping[str, Any]) -> None:
    things, sentences = picture["things"], picture["sentences"]
    named, asked = sum(one["named"] for one in things), sum(one["as_asked"] for one in sentences)
    end = picture["refused"].splitlines()[0] if picture["refused"] else f"{asked} of {len(sentences)} sentences done"
    tell(f"  {picture['picture']:20} {named} of {len(things)} labels kept, {end}, {picture['cpu_s']:.0f} s")
