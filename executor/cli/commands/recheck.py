"""`scene2demo recheck`: the independent check of a certificate."""

from __future__ import annotations

from executor.cli.command_options import RecheckOptions
from executor.cli.errors import DONE, FAILED
from executor.cli.output import print_json, say
from executor.scenes.library import load_own
from oag import recheck
from oag.model.codec import load
from oag.model.diagnostics import CertificateError


def execute(options: RecheckOptions) -> int:
    """Print whether a certificate supports its verdict about the given task and scene; return 0 when it does, else 1.

    Raises:
        TaskError, SceneError, SceneNotFound: The given task or scene cannot be read.
        CertificateError: The file is no JSON object, or one that is neither a certificate nor a report.
    """
    document = load(options.certificate, CertificateError)
    data = document.data
    if not isinstance(data, dict) or ("schema" not in data and "certificate" not in data):
        hint = "expected what `verify --certificate FILE` writes or `verify --json` prints"
        raise CertificateError("is no certificate", source=document.source, hint=hint)
    if "schema" not in data and isinstance(data.get("certificate"), dict):
        # What `verify --json` prints is a report, and the certificate is in it.
        data = data["certificate"]
    scene = None if options.scene is None else load_own(options.scene)
    result = recheck(data, task=options.task, scene=scene)
    if options.json:
        print_json({"ok": bool(result), "verdict": data.get("verdict"), "reason": result.reason})
    elif result:
        say(f"CONFIRMED  {data.get('verdict')}: {result.reason}", style="green")
    else:
        say(f"REJECTED   {result.reason}", style="red")
    return DONE if result else FAILED
