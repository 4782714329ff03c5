"""Reads files with LIBERO's own parser; runs under the reference's interpreter, never under this project's.

Reads one JSON request a line from standard input and writes one JSON answer a line:

    {"do": "use", "parser": PATH}  -> true; the file is LIBERO's `envs/bddl_utils.py`
    {"do": "read", "path": PATH}   -> what it returns, or {"error"}

LIBERO evaluates what it finds in a file as Python, so give it only files that you trust.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from types import ModuleType

ANSWERS = os.fdopen(os.dup(sys.stdout.fileno()), "w")
sys.stdout = sys.stderr


def load(path: str) -> ModuleType:
    """Return LIBERO's parser, without the packages around it, which need a simulator."""
    spec = importlib.util.spec_from_file_location("libero_parser", path)
    if spec is None or spec.loader is None:
        raise FileNotFoundError(path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main() -> None:
    """Answers requests until there are no more."""
    parser: ModuleType | None = None
    for line in sys.stdin:
        request = json.loads(line)
        answer: object = True
        if request["do"] == "use":
            parser = load(request["parser"])
        elif parser is not None:
            try:
                answer = parser.robosuite_parse_problem(request["path"])
            except Exception as error:
                answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=ANSWERS, flush=True)


if __name__ == "__main__":
    main()
