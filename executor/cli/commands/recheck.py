"""`scene2demo recheck`: the independent check of a certificate."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from executor.cli.errors import DONE, FAILED
from executor.cli.options import READ_SCENE, CommonOptions, DomainFile, Maybe, Read
from executor.cli.output import print_json, say


@dataclass(frozen=True)
class Options(CommonOptions):
    """Check a certificate without trusting the verifier that wrote it."""

    certificate: tyro.conf.Positional[Annotated[Path, Read("certificate")]]
    """The certificate's JSON file, or that of a report: what `verify --json` prints."""
    task: Annotated[Maybe[Path], Read("task")] = None
    """The task's JSON file that it has to be about; by default any."""
    scene: Annotated[Maybe[str], READ_SCENE] = None
    """Name of the scene, or the scene's JSON file, that it has to be about; by default any."""
    domain: DomainFile = None


def execute(options: Options) -> int:
    """Print whether a certificate supports its verdict about task and scene; return 0 when it does, else 1."""
    from executor.scenes.library import load_own
    from oag import recheck
    from oag.model.codec import load
    from oag.model.diagnostics import CertificateError
    from oag.model.domain import BUILT_IN, Domain

    domain = None if options.domain is None else Domain.from_toml(options.domain)
    document = load(options.certificate, CertificateError)
    data = document.data
    if not isinstance(data, dict) or ("schema" not in data and "certificate" not in data):
        hint = "expected what `verify --certificate FILE` writes or `verify --json` prints"
        raise CertificateError("is no certificate", source=document.source, hint=hint)
    if "schema" not in data and isinstance(data.get("certificate"), dict):
        # What `verify --json` prints is a report, and the certificate is in it.
        data = data["certificate"]
    scene = None if options.scene is None else load_own(options.scene, domain or BUILT_IN)
    result = recheck(data, task=options.task, scene=scene, domain=domain)
    if options.json:
        print_json({"ok": bool(result), "verdict": data.get("verdict"), "reason": result.reason})
    elif result:
        say(f"CONFIRMED  {data.get('verdict')}: {result.reason}", style="green")
    else:
        say(f"REJECTED   {result.reason}", style="red")
    return DONE if result else FAILED
