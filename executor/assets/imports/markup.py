"""The text of XML files, the same for every reader: UTF-8, without a document type, whatever its declaration says.

A parser believes the declaration. In UTF-7 or UTF-16 a file can so say to it what a look at its text does not show,
such as entities that grow to gigabytes or name other files. Readers get what was looked at, and no declaration.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from executor.assets.imports.folder import AssetFolder
from executor.assets.imports.problems import ImportRefused
from executor.machine.extras import require

# Also of versions of XML that there are not, which many files name.
_DECLARATION = re.compile(r"\A\s*<\?xml[^>]*\?>")


def read_markup(folder: AssetFolder, file: Path) -> str:
    """Returns the text of an XML file, without its declaration.

    Args:
        folder: Where the file is.
        file: The file.

    Raises:
        ImportRefused: It is no text, or has a document type or entities.
    """
    text = folder.read_text(file).removeprefix("\ufeff")
    if "\0" in text:
        raise ImportRefused(file, "is no text: it has characters that are none", "save it as UTF-8")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ImportRefused(file, "has a document type or entities", "remove them; neither is needed")
    return _DECLARATION.sub("", text, count=1)


def parsed_markup(folder: AssetFolder, file: Path) -> Any:
    """Returns the root element (of lxml) of an XML file; nothing that the text names is followed.

    Raises:
        ImportRefused: As for `read_markup`; or it is not well-formed.
        MissingExtra: lxml is not installed.
    """
    etree: Any = require("lxml.etree", "mesh")
    text = read_markup(folder, file)
    strict = etree.XMLParser(
        encoding="utf-8", resolve_entities=False, no_network=True, huge_tree=False, remove_blank_text=True
    )
    try:
        return etree.fromstring(text.encode(), strict)
    except etree.XMLSyntaxError as error:
        raise ImportRefused(file, f"is not well-formed XML: {error.msg}", "see the line and column it names") from error
