"""`scene2demo conversation`: print what a model was asked and what it answered, from a run's records."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from bddl.errors import Scene2DemoError
from bddl.terminal import pluralize
from executor.cli.errors import DONE, check
from executor.cli.options import CommonOptions, Flag, Maybe, Read
from executor.cli.output import print_json, say, tell

if TYPE_CHECKING:
    from llm.client.profiles import Price

RECORDING, CONVERSATIONS = "exchanges.jsonl", ("conversation.json", "conversations.json")
_SCHEMA = "scene2demo/conversation/1"


@dataclass(frozen=True)
class Options(CommonOptions):
    """Print a conversation with a model for people: who asked, the answer, what was wrong with it, tokens and cost."""

    file: tyro.conf.Positional[Annotated[Path, Read()]]
    """A run's folder, or one of its files: exchanges.jsonl (all requests and replies), conversation.json or
    conversations.json (rounds with findings and verdicts)."""
    round: Maybe[int] = None
    """Only this round, counted from 1."""
    prompts: Flag = False
    """Print the requests as well, which exchanges.jsonl alone has."""


class NoConversation(Scene2DemoError, ValueError):
    """A file holds no conversation with a model."""

    def __init__(self, path: Path, problem: str) -> None:
        super().__init__(f"{path}: {problem}; expected {RECORDING} or {' or '.join(CONVERSATIONS)} of a run")


@dataclass(frozen=True, slots=True)
class Entry:
    """One round, or a verdict between two.

    Attributes:
        number: From 1 in its conversation; 0 for a verdict.
        who: Who asked, such as "module 3".
        outcome: What became of it, in a word or two.
        reply: The answer as it came; empty for a verdict.
        findings: What was wrong with it, in words.
        model, seconds, input_tokens, output_tokens: Of the reply, as far as they are known.
        cost_usd: By list price; None where price or tokens are unknown.
        request: Texts of the request, where they are kept.
    """

    number: int
    who: str
    outcome: str
    reply: str = ""
    findings: tuple[str, ...] = ()
    model: str = ""
    seconds: float | None = None
    input_tokens: int | None = None
    output_tokens: int | None = None
    cost_usd: float | None = None
    request: tuple[str, ...] = ()


def execute(options: Options) -> int:
    """Print the entries of the conversations in a file; return 0."""
    path = _file(options.file)
    found = list(_recorded(path) if path.suffix == ".jsonl" else _written(path))
    count = max((entry.number for _, entries in found for entry in entries), default=0)
    good = options.round is None or 1 <= options.round <= count
    check(good, "--round", options.round, f"a round from 1 to {count}")
    shown = [(head, [one for one in each if options.round in (None, one.number)]) for head, each in found]
    if options.json:
        print_json({"ok": True, "file": str(path), "conversations": [_as_json(head, each) for head, each in shown]})
        return DONE
    for (head, entries), (_, everything) in zip(shown, found, strict=True):
        say(head, style="bold")
        for entry in entries:
            _print(entry, prompts=options.prompts)
        say(_total(everything))
    return DONE


def _as_json(head: str, entries: list[Entry]) -> dict[str, object]:
    return {"about": head, "entries": [asdict(entry) for entry in entries]}


def _file(path: Path) -> Path:
    """Return a file with a conversation: the path itself, or the one in a run's folder that says most."""
    if not path.is_dir():
        return path
    for name in (*CONVERSATIONS, RECORDING):
        if (path / name).is_file():
            return path / name
    raise NoConversation(path, "the folder has no conversation")


def _recorded(path: Path) -> Iterator[tuple[str, list[Entry]]]:
    """Yield the exchanges of a recording as one conversation."""
    from llm.client.recording import read_recording
    from llm.client.transport import ChatReply
    from llm.structured.conversation import asker

    exchanges, warnings = read_recording(path)
    entries = []
    for number, exchange in enumerate(exchanges, start=1):
        who = asker(exchange.module) if exchange.module else "a request"
        reply, texts = exchange.outcome, _texts(exchange.request)
        if isinstance(reply, ChatReply):
            numbers = (reply.latency_s, reply.input_tokens, reply.output_tokens)
            entries.append(Entry(number, who, "answered", reply.text, (), reply.model, *numbers, None, texts))
        else:
            entries.append(Entry(number, who, "no reply", findings=(str(reply),), model=reply.model, request=texts))
    versions = sorted({exchange.version for exchange in exchanges if exchange.version})
    by = f", recorded by version {' and '.join(versions)}" if versions else ""
    yield f"{path}: {pluralize(len(exchanges), 'exchange')}{by}", entries
    for warning in warnings:
        tell(f"note: {warning}", style="yellow")


def _texts(request: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the texts of a recorded request, a picture as its hash."""
    texts = [f"system: {request.get('system') or '(none)'}"]
    for message in request.get("messages") or ():
        parts = message.get("parts") or ()
        shown = [part if isinstance(part, str) else f"(picture {str(part.get('image'))[:12]})" for part in parts]
        texts.append(f"{message.get('role')}: " + "\n".join(shown))
    return tuple(texts)


def _written(path: Path) -> Iterator[tuple[str, list[Entry]]]:
    """Yield the conversations that a run has written."""
    from executor.system.files import read_json

    try:
        data = read_json(path)
    except (ValueError, OSError) as error:
        raise NoConversation(path, f"it cannot be read ({error})") from error
    for one in data if isinstance(data, list) else [data]:
        if not isinstance(one, dict) or one.get("schema") != _SCHEMA or not isinstance(one.get("entries"), list):
            raise NoConversation(path, "it is no conversation")
        model = str(one.get("model"))
        version = f", version {one['version']}" if one.get("version") else ""
        head = f"{model} about {one.get('query')!r} in {one.get('scene')}{version}"
        price = _price(model)
        yield head, [_entry(entry, price) for entry in one["entries"] if isinstance(entry, dict)]


def _price(model: str) -> Price | None:
    from llm.client.profiles import find_profile
    from llm.errors import ModelConfigError

    with suppress(ModelConfigError):
        return find_profile(model).price
    return None


def _entry(data: Mapping[str, Any], price: Price | None) -> Entry:
    from llm.structured.conversation import asker

    findings = tuple(
        f"{found.get('code')}: {found.get('message')}"
        for found in data.get("findings") or ()
        if isinstance(found, dict)
    )
    if data.get("kind") != "round":
        blamed = data.get("blamed")
        again = f", {asker(blamed)} is asked again" if isinstance(blamed, int) else ""
        return Entry(0, "verdict", f"{data.get('verdict')}{again}", findings=findings)
    tokens = (_whole(data.get("input_tokens")), _whole(data.get("output_tokens")))
    cost = None
    if price is not None and tokens[0] is not None and tokens[1] is not None:
        cost = price.cost_usd(tokens[0], tokens[1])
    seconds = data.get("latency_s")
    return Entry(
        number=_whole(data.get("number")) or 0,
        who=asker(_whole(data.get("module")) or 0),
        outcome="accepted" if data.get("accepted") is True else "refused",
        reply=str(data.get("reply", "")),
        findings=findings,
        seconds=seconds if isinstance(seconds, float | int) else None,
        input_tokens=tokens[0],
        output_tokens=tokens[1],
        cost_usd=cost,
    )


def _whole(value: object) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _print(entry: Entry, *, prompts: bool) -> None:
    numbers = [] if entry.seconds is None else [f"{entry.seconds:.1f} s"]
    if entry.input_tokens is not None and entry.output_tokens is not None:
        numbers.append(f"{entry.input_tokens} + {entry.output_tokens} tokens")
    if entry.cost_usd is not None:
        numbers.append(f"${entry.cost_usd:.4f}")
    style = {"accepted": "green", "answered": None}.get(entry.outcome, "yellow")
    head = f"{entry.number}. {entry.who}" if entry.number else entry.who
    say(f"\n{', '.join((f'{head}: {entry.outcome}', *numbers))}", style=style)
    for text in entry.request if prompts else ():
        say("\n".join(f"  > {line}" for line in text.splitlines()), style="dim")
    for line in _indented(entry.reply):
        say(f"  {line}")
    for finding in entry.findings:
        say(f"  - {finding}", style="yellow")


def _indented(reply: str) -> list[str]:
    """Return the lines of a reply; JSON is laid out."""
    with suppress(ValueError, RecursionError):
        return json.dumps(json.loads(reply), indent=2, ensure_ascii=False).splitlines()
    return reply.splitlines()


def _total(entries: list[Entry]) -> str:
    rounds = [entry for entry in entries if entry.number]
    inputs, outputs = (sum(getattr(entry, name) or 0 for entry in rounds) for name in ("input_tokens", "output_tokens"))
    costs = [entry.cost_usd for entry in rounds if entry.cost_usd is not None]
    cost = f"${sum(costs):.4f} by list price" if costs and len(costs) == len(rounds) else "cost unknown"
    return f"\n{pluralize(len(rounds), 'round')}, {inputs} + {outputs} tokens, {cost}\n"
