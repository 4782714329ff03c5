"""A model in a file: a server of its own on the loopback interface, which ends with its pipe."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bddl.errors import MissingExtra
from llm.client import local
from llm.client.connect import connect
from llm.client.openai import chat_body
from llm.client.profiles import find_profile
from llm.client.transport import ChatRequest
from llm.errors import ModelConfigError

# Stands for the library: its server says which bounds of the schema arrived.
FAKE = """
import json, threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from types import SimpleNamespace

class Answering(BaseHTTPRequestHandler):
    def do_POST(self):
        asked = json.loads(self.rfile.read(int(self.headers["content-length"])))
        schema = json.loads(asked["grammar"].partition("start: %json ")[2])
        text = json.dumps([sorted(schema["properties"]["goal"]), schema["x-guidance"]["whitespace_flexible"]])
        choice = {"message": {"content": text}, "finish_reason": "stop"}
        usage = {"prompt_tokens": asked["max_tokens"], "completion_tokens": 1}
        body = json.dumps({"choices": [choice], "usage": usage})
        self.send_response(200)
        self.send_header("content-type", "application/json")
        self.end_headers()
        self.wfile.write(body.encode())
    def log_message(self, *words):
        pass

def CommonParams():
    return SimpleNamespace(model=SimpleNamespace(), sampling=SimpleNamespace(), cpuparams=SimpleNamespace(),
                           cpuparams_batch=SimpleNamespace())

class Server:
    def __init__(self, params):
        if "broken" in params.model.path:
            raise RuntimeError("no tensors in it")
        print("a line of the library's log", flush=True)
        served = HTTPServer((params.hostnames[0], params.port), Answering)
        threading.Thread(target=served.serve_forever, daemon=True).start()
        self.listening_address = f"http://127.0.0.1:{served.server_port}"
"""
SCHEMA = {"type": "object", "properties": {"goal": {"type": "string", "maxLength": 9}}, "required": ["goal"]}


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Put a library that stands for llama.cpp's in the path of this process and its children; return a folder."""
    (tmp_path / "xllamacpp.py").write_text(FAKE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return tmp_path


def test_a_file_is_served_once_on_the_loopback_interface_and_ends_with_the_pipe(library: Path) -> None:
    file = library / "small.gguf"
    file.write_bytes(b"GGUF and more")
    model = connect(f"local:{file}")
    sent = json.loads(model.complete(ChatRequest.of("s", "q", json_schema=SCHEMA)).text)
    assert sent == [["maxLength", "type"], False]
    # Every reply is bounded, and nothing is paid.
    assert model.usage.input_tokens == find_profile("local:x").max_tokens and model.usage.cost_usd == 0.0
    server = local._LocalServer.of(file.resolve())
    assert server.address.startswith("http://127.0.0.1:") and connect(f"local:{file}") is not model
    assert local._LocalServer.of(file.resolve()) is server and server.process.poll() is None
    assert server.process.stdin is not None
    server.process.stdin.close()
    assert server.process.wait(timeout=10) == 0


def test_what_cannot_be_served_is_said_with_its_reason(library: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other, broken = library / "notes.txt", library / "broken.gguf"
    other.write_text("text")
    broken.write_bytes(b"GGUF")
    for file, words in (
        (library / "none.gguf", "cannot be read"),
        ("~nobody-of-this-name/x.gguf", "cannot be read"),
        (other, "no GGUF file"),
        (broken, "no tensors in it"),
    ):
        with pytest.raises(ModelConfigError, match=words):
            connect(f"local:{file}")
        if file != broken:
            with pytest.raises(ModelConfigError, match=words):
                connect(f"local:{file}", starts=False)
    connect(f"local:{broken}", starts=False)  # All is checked but what only its start tells.
    monkeypatch.setattr(local, "find_spec", lambda _: None)
    for starts in (True, False):
        with pytest.raises(MissingExtra, match="extra 'local'"):
            connect(f"local:{broken}", starts=starts)


def test_a_server_that_does_not_start_in_time_is_ended_with_this_reason(
    library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (library / "xllamacpp.py").write_text("import time\ntime.sleep(60)")
    (library / "slow.gguf").write_bytes(b"GGUF")
    monkeypatch.setattr(local, "_LONGEST_START_S", 0.1)
    with pytest.raises(ModelConfigError, match=r"did not start within 0\.1 s, without output"):
        connect(f"local:{library / 'slow.gguf'}")


def test_bounds_are_sent_only_to_endpoints_that_know_them() -> None:
    request = ChatRequest.of(
        "s", "q", json_schema={**SCHEMA, "properties": {"maxLength": {"type": "string", "maxLength": 9}}}
    )
    sent = [chat_body(request, find_profile(name))["response_format"] for name in ("llama-cpp:x", "openai:gpt-4o")]
    known, plain = (one["json_schema"]["schema"]["properties"] for one in sent)
    assert known == {"maxLength": {"type": "string", "maxLength": 9}} and plain == {"maxLength": {"type": "string"}}
