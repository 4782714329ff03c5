"""`scene2demo recheck`: the independent check of a certificate."""

from __future__ import annotations

import json

from bddl.files import read_bounded_text
from executor.cli.errors import DONE, FAILED, BadOption
from executor.cli.options import RecheckOptions
from executor.cli.output import print_json, say
from executor.scenes.library import load_scene
from oag import recheck
from oag.model.jsonfile import STRICT


def execute(options: RecheckOptions) -> int:
    """Prints whether a certificate bears out its verdict, about what is asked; returns 0 when it does, else 1.

    Raises:
        TaskError, SceneError, SceneNotFound: The task or the scene that is asked about cannot be read.
        BadOption: When the file is no JSON object, or one that is neither a certificate nor a report.
    """
    path = options.certificate
    try:
        data = STRICT.decode(read_bounded_text(path))
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise BadOption(str(path), "is not valid JSON", f"a certificate ({error.msg} at {place})") from None
    except UnicodeDecodeError:
        raise BadOption(str(path), "is not text", "a certificate's JSON file") from None
    except (RecursionError, ValueError) as error:
        # A key twice, NaN, nested deeper than the decoder goes, or a number of more digits than it reads.
        raise BadOption(str(path), "is not valid JSON", f"a certificate ({error})") from None
    if not isinstance(data, dict):
        raise BadOption(str(path), "is no certificate", "a JSON object with schema, plan, links and verdict")
    if "schema" not in data and "certificate" not in data:
        expected = "what `verify --certificate FILE` writes or `verify --json` prints"
        raise BadOption(str(path), "is no certificate", expected)
    if "schema" not in data and isinstance(data.get("certificate"), dict):
        # What `verify --json` prints is a report, and the certificate is in it.
        data = data["certificate"]
    scene = None if options.scene is None else load_scene(options.scene)
    result = recheck(data, task=options.task, scene=scene)
    if options.json:
        print_json({"ok": bool(result), "verdict": data.get("verdict"), "reason": result.reason})
    elif result:
        say(f"CONFIRMED  {data.get('verdict')}: {result.reason}", style="green")
    else:
        say(f"REJECTED   {result.reason}", style="red")
    return DONE if result else FAILED
