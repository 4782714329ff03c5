"""Prompts: templates, the fence between instructions and data, and tables of scene, primitives and predicates.

Names, categories and queries come from others. They stand between `<<<label` and `label>>>`, which the data
itself cannot contain; the instructions say that nothing inside is an instruction. The tables are generated from
`oag` and `bddl`, so that a prompt cannot promise what the checks do not know.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from string import Template

import bddl
from llm.client.transport import ChatRequest, Message, Part
from llm.structured.conversation import INSPECTOR, SPOTTER, SUPERVISOR
from oag import Diagnostic, Primitive, Scene, SceneObject, SimpleTask
from oag.model.symbols import (
    ANY,
    EMPTY,
    GRIPPER,
    Fact,
    ParameterKind,
    Value,
    fact_text,
    gripping,
    holding,
    parameter_kind,
)
from oag.primitives.cargo import RESTING
from oag.primitives.table import Context, Placement, effect, requirements
from oag.wellformed import kind_problem

# Longest part of a model's own answer that is sent back to it.
_LONGEST_SHOWN = 12_000
_MOST_FINDINGS = 12
_TEMPLATES: Mapping[int, tuple[str, ...]] = {
    1: ("proposing/system", "proposing/module_1", "proposing/module_1_reading"),
    **{number: ("proposing/system", f"proposing/module_{number}") for number in (4, 5)},
    **{
        number: ("proposing/system", *(f"proposing/module_{number}{part}" for part in ("", "_door", "_bare")))
        for number in (2, 3)
    },
    INSPECTOR: ("evolve/system", "evolve/inspector"),
    SUPERVISOR: ("evolve/system", "evolve/supervisor"),
    SPOTTER: ("vision/system", "vision/pattern", "vision/things"),
}


@dataclass(frozen=True, slots=True)
class Prompt:
    """The first question of a module, before any answer.

    Attributes:
        module: 1 to 5, or `llm.structured.conversation.INSPECTOR`, `SUPERVISOR`, or `SPOTTER`.
        system: Instructions above the conversation.
        text: The module's question with its data.
        images: Pictures of the question; a text before one is its caption.
    """

    module: int
    system: str
    text: str
    images: tuple[Part, ...] = ()

    @property
    def sha256(self) -> str:
        """SHA-256 of the whole prompt, pictures included."""
        shown = (part if isinstance(part, str) else part.sha256 for part in self.images)
        parts = (self.system, self.text, *shown)
        return hashlib.sha256("\x00".join(parts).encode("utf-8", "backslashreplace")).hexdigest()

    def request(
        self, schema: Mapping[str, object], refused: Refused | None = None, temperature: float | None = None
    ) -> ChatRequest:
        """Return the request for this prompt; after a refused answer it includes the findings about it."""
        messages = [Message((self.text, *self.images))]
        if refused is not None:
            messages += [Message((_shown(refused.reply),), "assistant"), Message((refused.text(schema),))]
        return ChatRequest(
            self.system,
            tuple(messages),
            schema,
            temperature=temperature,
            module=self.module,
            template=template_sha256(self.module),
        )


@dataclass(frozen=True, slots=True)
class Refused:
    """An answer that is returned to the model, with the findings about it and, a line each, about earlier ones.

    Attributes:
        reply: The answer.
        findings: What is wrong with it.
        before: What was wrong with earlier ones.
        entries: Numbers of the entries that are to be written again; empty where the whole answer is.
    """

    reply: str
    findings: tuple[Diagnostic, ...]
    before: tuple[str, ...] = ()
    entries: tuple[int, ...] = ()

    def text(self, schema: Mapping[str, object]) -> str:
        """Return the message to the model: the numbered findings, earlier failures, and what to write.

        Verified changes come last. Qwen2.5-Coder-1.5B made a change in 6 of 6 draws that stood there, and in 2 of 6
        that stood among the findings.
        """
        shown = self.findings[:_MOST_FINDINGS]
        listed = [_numbered(number, replace(found, fixes=())) for number, found in enumerate(shown, start=1)]
        if len(self.findings) > len(shown):
            listed.append(f"... and {len(self.findings) - len(shown)} more of this kind.")
        before = "Earlier answers were refused for:\n" + "\n".join(self.before) + "\n" if self.before else ""
        fixes = list(dict.fromkeys(fix for found in shown for fix in found.fixes))
        if all(found.severity != "error" for found in self.findings):
            closing = "If your answer is what the query means, give the same answer again; otherwise mend it."
        elif self.entries:
            which = ", ".join(map(str, self.entries))
            closing = f"Mend every point: write the entries with sub_task {which} again, each in full, and no others."
        else:
            closing = "Mend every point, keep the rest as it is, and answer again in full."
        changes = ("A change that was checked and works:", fenced("change", "\n".join(fixes)), "") if fixes else ()
        findings = fenced("findings", "\n\n".join(listed))
        texts = {"findings": findings, "before": before, "changes": "\n\n".join(changes), "closing": closing}
        return render("structured/feedback", **texts, form=form_of(schema))


def render(name: str, **values: str) -> str:
    """Fill in the template of a prompt.

    Args:
        name: Folder and file below `llm/prompts`, such as "proposing/module_3".
        values: Text for each `$place`; the texts themselves are not substituted again.

    Raises:
        KeyError: A place of the template has no text.
    """
    return _template(name).substitute(values).strip() + "\n"


@cache
def template_sha256(module: int) -> str:
    """Return the SHA-256 of the templates of which a module's prompts are made; empty for an unknown module."""
    names = _TEMPLATES.get(module)
    if names is None:
        return ""
    texts = (_template(name).template for name in (*names, "structured/feedback", "structured/primitives"))
    return hashlib.sha256("\x00".join(texts).encode()).hexdigest()


@cache
def _template(name: str) -> Template:
    room, _, file = name.partition("/")
    return Template((resources.files("llm") / "prompts" / room / f"{file}.md").read_text(encoding="utf-8"))


def form_of(schema: object) -> str:
    """Return the form of an answer with dots in place of its texts, such as `{"goal": "...", "problem": "..."}`."""
    if not isinstance(schema, Mapping):
        return "..."
    properties, items = schema.get("properties"), schema.get("items")
    if isinstance(properties, Mapping):
        return "{" + ", ".join(f"{json.dumps(name)}: {form_of(one)}" for name, one in properties.items()) + "}"
    if isinstance(items, Mapping):
        return f"[{form_of(items)}, ...]"
    return '"..."' if schema.get("type") == "string" else "..."


def fenced(label: str, text: str) -> str:
    """Return data between marks that the data cannot contain."""
    inside = re.sub(r">(?=>)", "> ", re.sub(r"<(?=<)", "< ", text))
    return f"<<<{label}\n{inside}\n{label}>>>"


def summary(findings: Sequence[Diagnostic]) -> str:
    """Return the findings about an answer in one line."""
    return "- " + "; ".join(dict.fromkeys(f"{found.code} {found.place}".strip() for found in findings[:_MOST_FINDINGS]))


def _numbered(number: int, found: Diagnostic) -> str:
    first, *rest = str(found).splitlines()
    return "\n".join((f"{number}. {first}", *(f"   {line}" for line in rest)))


def _shown(reply: str) -> str:
    """Return an earlier reply as it is sent back; servers reject empty texts and half surrogate pairs."""
    whole = reply.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")
    text = whole.strip() or "(an empty reply)"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]} ... (cut here)"


CHANGEABLE = frozenset({*RESTING, "open"})
"""Predicates that primitives change; a goal about any other one is unreachable."""

_LONGEST_NAME = 80
_UNITS = {
    ParameterKind.NONE: "-",
    ParameterKind.DISTANCE_M: "metres",
    ParameterKind.ANGLE_DEG: "degrees",
    ParameterKind.JOINT_LIMITS: "from, to (0 to 1)",
}


def scene_table(scene: Scene, only: Collection[str] | None = None, *, measures: bool = True) -> str:
    """Return a scene as text: objects with category, type, size and position, and the facts known at the start.

    Args:
        scene: The scene.
        only: The objects that get a row; all others are counted by category, and their facts left out.
        measures: Whether sizes and positions are shown.
    """
    x, y, _ = scene.robot.position
    shown = [thing for thing in scene.objects.values() if only is None or thing.id in only]
    lines = [f"robot at ({x:.2f}, {y:.2f}), heading {scene.robot.yaw_rad:.2f} rad"] if measures else []
    lines.append("id | category | type | kind" + " | size x y z [m] | centre x y z [m]" * measures)
    stated = [literal for fact in scene.facts for literal in bddl.literals(fact) or ()]
    # A small model reads a word in the row sooner than a formula below the table.
    doors = {one.atom.args: ", open" if one.value else ", closed" for one in stated if one.atom.predicate == "open"}
    lines.extend(_object_row(thing, doors.get((thing.id,), ""), measures=measures) for thing in shown)
    if len(shown) < len(scene.objects):
        ids = {thing.id for thing in shown}
        lines.append(_others([thing for thing in scene.objects.values() if thing.id not in ids]))
    predicates = set(bddl.PREDICATES) if measures else {*CHANGEABLE}
    if len({one.atom.args[-1] for one in stated if one.atom.predicate == "inroom"}) <= 1:
        # Where all is in one room, the room tells nothing.
        predicates.discard("inroom")
    facts = [bddl.format(fact) for fact in scene.facts if _is_listed(fact, scene, only, predicates)]
    whole = len(shown) == len(scene.objects)
    nothing = "nothing is stated" + " that primitives change" * (not measures) + " of the listed objects" * (not whole)
    lines.append(f"at the start: {' '.join(facts) or nothing}")
    closed = ", ".join(name for name in sorted(scene.closed) if name in predicates)
    among = "" if whole else "among the listed objects, "
    known = f"{among}of {closed} everything true is listed; what is not listed is false"
    lines.append(known if closed else "the rest is unknown")
    return "\n".join(lines)


_MOST_CATEGORIES = 20


def _others(things: Sequence[SceneObject]) -> str:
    counts = Counter(thing.category for thing in things).most_common()
    listed = [f"{count} {quoted(category)}" for category, count in counts[:_MOST_CATEGORIES]]
    more = len(counts) - len(listed)
    text = f"the scene has more objects; not listed: {', '.join(listed)}"
    return f"{text}, and {more} more categories" if more > 0 else text


def _is_listed(fact: bddl.Formula, scene: Scene, only: Collection[str] | None, predicates: Collection[str]) -> bool:
    """Decide whether a fact is about shown objects and given predicates alone."""
    atoms = bddl.atoms(fact)
    named = {name for atom in atoms for name in atom.args if name in scene.objects}
    return (only is None or named <= {*only}) and all(atom.predicate in predicates for atom in atoms)


def concerned(scene: Scene, named: Iterable[str]) -> frozenset[str]:
    """Return objects with what they stand in or on, and what stands in or on an item of theirs, by the facts."""
    facts = [literal for fact in scene.facts for literal in bddl.literals(fact) or ()]
    rests = [one.atom.args for one in facts if one.value and one.atom.predicate in RESTING and len(one.atom.args) == 2]
    found = {name for name in named if name in scene.objects}
    for _ in rests:
        below = {support for thing, support in rests if thing in found}
        on_items = {thing for thing, support in rests if support in found and scene[support].role == "B"}
        more = {name for name in below | on_items if name in scene.objects} - found
        if not more:
            break
        found |= more
    return frozenset(found)


def _object_row(thing: SceneObject, door: str, *, measures: bool) -> str:
    row = f"{thing.id} | {quoted(thing.category)} | {thing.role} | {thing.kind.value}{door}"
    if not measures:
        return row
    size, place = (" ".join(f"{value:.2f}" for value in values) for values in (thing.extent_m, thing.position))
    return f"{row} | {size} | {place}"


def quoted(name: str) -> str:
    """Return a foreign name as a JSON string of bounded length, without characters that could close a fence."""
    short = name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}..."
    return json.dumps(short).replace("<", "\\u003c").replace(">", "\\u003e")


@cache
def primitive_table() -> str:
    """Return the library of primitives as a table: ID, name, numbers, preconditions, effects."""
    lines = ["ID | name | numbers | needs | then"]
    for primitive in Primitive:
        needs, then = _meaning(primitive)
        unit = _UNITS[parameter_kind(primitive)]
        lines.append(f"{int(primitive)} | {primitive.name} | {unit} | {needs or '-'} | {then or '-'}")
    return "\n".join(lines)


def primitives_text(only: Primitive | None = None) -> str:
    """Return the library of primitives, or one row of it, with an explanation of its words."""
    head, *rows = primitive_table().splitlines()
    shown = [row for row in rows if only is None or row.startswith(f"{int(only)} |")]
    if not shown and only is not None:
        shown = [f"{int(only)} | {only.name}: of the task's own domain, which is not part of this table"]
    return render("structured/primitives", table="\n".join((head, *shown))).rstrip()


def _meaning(primitive: Primitive) -> tuple[str, str]:
    """Return preconditions and effects of a primitive, for a target T and a support S that is a container."""
    texts = []
    leaves: set[Fact] = set()
    for is_item in (True, False):
        context = Context("T", "S", Placement("inside", "S"), is_item, ("S",))
        hand: Value = holding("T") if is_item else gripping("T")
        hand = EMPTY if primitive is Primitive.GRASP else hand
        clauses = requirements(primitive, context, hand)
        needs = "; ".join(" or ".join(condition.text() for condition in clause) for clause in clauses)
        written = effect(primitive, context, hand)
        # An effect on held items only would read like an effect on every target.
        off_its_place = {
            (fact, value) for fact, value in written if fact[0] in RESTING and fact[1] == "T" and not value
        }
        off_its_place -= set(effect(primitive, context, EMPTY))
        leaves |= {fact for fact, _ in off_its_place}
        effects = [entry for entry in written if _is_shown(*entry) and entry not in off_its_place]
        texts.append((needs, "; ".join(fact_text(fact, value) for fact, value in effects)))
    (item_needs, item_then), (door_needs, door_then) = texts
    # A motion by which a held target leaves places: all of them, or not.
    along = "" if not leaves else "; carries" if ("inside", "T", ANY) in leaves else "; moves"
    return _either(item_needs, door_needs), _either(item_then, door_then) + along


def _is_shown(fact: tuple[str, ...], value: Value) -> bool:
    return value is not None and (value is not False or fact[0] in CHANGEABLE) and fact[1:] != ("S", "T")


def _either(item: str, fixture: str) -> str:
    if item == fixture:
        return item
    return " / ".join(f"{kind}: {text}" for kind, text in (("item", item), ("fixture", fixture)) if text)


_ESCAPED_SPACE = re.escape(" ")
# More objects than these have no pattern. Of few objects a formula has some literals more than there are.
_MOST_IN_PATTERN = 60
_MORE_LITERALS = 4


def formula_pattern(scene: Scene, ids: Sequence[str], target: str = "", places: Sequence[str] = ()) -> str:
    """Return the regular expression of formulas that can hold in a scene, for endpoints that follow a schema strictly.

    These are literals about what primitives change, and their conjunctions and disjunctions: a quantified goal is
    written out over the objects. It is empty where nothing can be written so, or there are many objects.

    Args:
        scene: The scene.
        ids: The objects that may be named.
        target: An item that is in or on nothing but `places`; it may be denied that it is elsewhere.
        places: These places.
    """
    if len(ids) > _MOST_IN_PATTERN:
        return ""
    doors = _possible("open", [()], ids, scene)
    items, everywhere = [key for key in ids if scene[key].role == "B"], [*ids, GRIPPER]
    free = [key for key in items if key != target]
    held = _rest_patterns(free, everywhere, scene) + (_rest_patterns([target], places, scene) if target else [])
    denied = _rest_patterns(items, everywhere, scene)
    opened = [f"open {one_of(doors)}"] if doors else []
    if not opened + held:
        return ""
    literal = rf"(\(({'|'.join(opened + held)})\)|\(not \(({'|'.join(opened + denied)})\)\))"
    return rf"({literal}|\((and|or)( {literal}){{2,{len(ids) + _MORE_LITERALS}}}\))"


def _rest_patterns(items: Sequence[str], places: Sequence[str], scene: Scene) -> list[str]:
    """Return the patterns of what some items may be in or on."""
    patterns = []
    for predicate in sorted(RESTING) if items else ():
        admitted = _possible(predicate, [(item,) for item in items], places, scene)
        patterns += [f"{predicate} {one_of(items)} {one_of(admitted)}"] if admitted else []
    return patterns


def _possible(predicate: str, firsts: Sequence[tuple[str, ...]], lasts: Iterable[str], scene: Scene) -> list[str]:
    """Return the last arguments that a predicate's kinds admit with any of the first ones."""
    return [
        name
        for name in lasts
        if any(kind_problem(bddl.Atom(predicate, (*first, name)), scene) is None for first in firsts)
    ]


def one_of(texts: Iterable[str]) -> str:
    """Return the regular expression of one of some texts."""
    return f"({'|'.join(re.escape(text).replace(_ESCAPED_SPACE, ' ') for text in texts)})"


@cache
def predicate_table() -> str:
    """Return the predicates that primitives change, with arguments and meaning, and the names of the others."""
    rows = [f"{spec.shape}  {spec.meaning}" for name, spec in bddl.PREDICATES.items() if name in CHANGEABLE]
    others = ", ".join(name for name in bddl.PREDICATES if name not in CHANGEABLE)
    held = "(inside ITEM gripper)  the robot's hand holds the item"
    return "\n".join([*rows, held, f"no primitive changes these, so no goal can ask for them: {others}"])


def subtask_table(subtasks: Sequence[SimpleTask], *, conditions: bool = True) -> str:
    """Return the subtasks as far as they are known, a line each."""
    rows = []
    for number, subtask in enumerate(subtasks, start=1):
        row = f"{number} | {subtask.name} | target {subtask.target}"
        row += f" | support_init {subtask.support_init or '-'} | support_goal {subtask.support_goal or '-'}"
        if conditions:
            row += f" | init {bddl.format(subtask.init)} | goal {bddl.format(subtask.goal)}"
        rows.append(row)
    return "\n".join(rows)
