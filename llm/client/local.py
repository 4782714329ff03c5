"""A model in a file on this machine: start a server for it, once a process, and end it with the process."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryFile
from threading import Event, Timer

from bddl.errors import MissingExtra
from llm.client.profiles import ModelProfile
from llm.errors import ModelConfigError

# Reading a model of several GB from a slow disk takes minutes.
_LONGEST_START_S = 600.0
_MAGIC = b"GGUF"
# Address of a server that is not started; no server listens at this port.
_NOWHERE = "http://127.0.0.1:1"


def served(profile: ModelProfile, *, starts: bool = True) -> ModelProfile:
    """Return a profile with the address of a server for its file; other profiles as they are.

    Args:
        profile: The profile.
        starts: Whether the server is started; without it the file and the library are checked, and nothing answers.

    Raises:
        ModelConfigError: The file cannot be read, is no GGUF file, or the server does not start with it.
        MissingExtra: The server's library is not installed.
    """
    if not profile.serve:
        return profile
    try:
        # RuntimeError: "~name" of a user that this machine does not have.
        file = Path(profile.model).expanduser()
        with file.open("rb") as stream:
            begins = stream.read(len(_MAGIC))
    except (OSError, RuntimeError, ValueError) as error:
        problem = f"the model's file cannot be read: {getattr(error, 'strerror', None) or str(error).rstrip('.')}"
        raise ModelConfigError(profile.name, problem, "Name a GGUF file, as in local:models/qwen.gguf") from error
    if begins != _MAGIC:
        raise ModelConfigError(profile.name, "the file is no GGUF file", "llama.cpp reads models in this format")
    if find_spec("xllamacpp") is None:
        raise MissingExtra("xllamacpp", "local")
    address = _LocalServer.of(file.resolve()).address if starts else _NOWHERE
    return profile.model_copy(update={"base_url": f"{address}/v1"})


class _LocalServer:
    """A server in a process of its own, which ends when the pipe to it closes.

    Attributes:
        address: Its address on the loopback interface.
        process: Its process.
    """

    def __init__(self, file: Path) -> None:
        program = Path(__file__).with_name("local_server.py")
        with TemporaryFile() as log:
            self.process = subprocess.Popen(
                [sys.executable, str(program), str(file)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log
            )
            late = Event()

            def give_up() -> None:
                late.set()
                self.process.kill()

            patience = Timer(_LONGEST_START_S, give_up)
            patience.start()
            try:
                lines = iter(self.process.stdout or ())
                self.address = next((line.decode().strip() for line in lines if line.startswith(b"http://")), "")
            finally:
                patience.cancel()
            if self.address:
                return
            self.process.kill()
            self.process.communicate()
            log.seek(0)
            output = [line for line in log.read()[-4000:].decode("utf-8", "replace").splitlines() if line.strip()]
        late_text = f"the server did not start within {_LONGEST_START_S:g} s"
        reason = late_text if late.is_set() else "the server ended before it answered"
        problem = f"{reason}; its last line: {output[-1].strip()}" if output else f"{reason}, without output"
        raise ModelConfigError(f"local:{file}", problem, "Is the file whole, and is there memory for it?")

    @classmethod
    @cache
    def of(cls, file: Path) -> _LocalServer:
        """Return the running server of a file."""
        return cls(file)
