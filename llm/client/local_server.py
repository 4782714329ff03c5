"""Serve a GGUF file by llama.cpp on the loopback interface until the standard input ends.

A program of its own, run by `llm.client.local`: it imports nothing of this project. The end of its parent closes the
pipe that it reads, also after a kill, so that no server outlives the run.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Any

# Tokens of one question with its answer; memory for prompts whose beginnings come again [MiB].
_CONTEXT = 8192
_CACHE_MIB = 2048
_TEMPERATURE = 0.3


def parameters(file: str) -> Any:
    """Return the parameters of a server for a model's file; raises ImportError without the library."""
    params = import_module("xllamacpp").CommonParams()
    params.model.path = file
    params.model_alias = {os.path.basename(file)}
    params.hostnames, params.port = ["127.0.0.1"], 0
    params.n_ctx, params.cache_ram_mib = _CONTEXT, _CACHE_MIB
    params.sampling.temp = _TEMPERATURE
    # Threads wait for each other actively: more than there are cores would be slow.
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    params.cpuparams.n_threads = params.cpuparams_batch.n_threads = cores
    params.ui = False
    return params


def main(file: str) -> None:
    """Start the server, print its address, and end with the standard input."""
    server = import_module("xllamacpp").Server(parameters(file))
    print(server.listening_address, flush=True)
    sys.stdin.buffer.read()
    # The library's threads would keep the process alive.
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1])
