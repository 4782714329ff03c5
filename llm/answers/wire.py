"""The JSON schema of an answer as endpoints take it: no references, no unions, no optional fields, no bounds.

The bounds are checked here when the answer arrives; several endpoints reject a request whose schema states them.
"""

from __future__ import annotations

from collections.abc import Mapping

from llm.answers.base import Answer

_KEPT = ("type", "description", "enum")


def wire_schema(answer: type[Answer]) -> dict[str, object]:
    """Returns the flat JSON schema of an answer."""
    full = answer.model_json_schema()
    return _flat(full, full.get("$defs", {}))


def _flat(node: Mapping[str, object], known: Mapping[str, Mapping[str, object]]) -> dict[str, object]:
    """Returns a schema with its references written out; answers nest three levels deep, and none holds itself."""
    reference = node.get("$ref")
    if isinstance(reference, str):
        return _flat(known[reference.rpartition("/")[2]], known)
    written = {key: node[key] for key in _KEPT if key in node}
    items, properties = node.get("items"), node.get("properties")
    if isinstance(items, Mapping):
        written["items"] = _flat(items, known)
    if isinstance(properties, Mapping):
        written["properties"] = {key: _flat(value, known) for key, value in properties.items()}
        written["required"] = list(properties)
        written["additionalProperties"] = False
    if written.get("type") == "object":
        # A docstring is for readers of the code.
        written.pop("description", None)
    return written
