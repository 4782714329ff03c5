"""The offline planner: understand a query by lexicon and grammar, and propose a task by templates, without a model.

Module 1's decisive part is here: the intents of a query, grounded in the scene, and the task goal G. G is read
off the query and the scene, not off the subtasks, so that a decomposition that drops one is detected.

Source: the paper's Semantic Expansion; G is a departure (docs/semantics.md).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, islice

import bddl
import oag
from llm.errors import QueryError, RefusalCode
from llm.offline.grounding import Grounding
from llm.offline.intents import (
    PREPOSITION,
    Intent,
    IntentKind,
    Refusal,
    Request,
    Support,
    Surroundings,
    enumeration,
    no_action,
)
from llm.offline.interpretation import interpret_reading
from llm.offline.lexicon import Lexicon, built_in
from llm.offline.names import Names
from llm.offline.reader import TOO_LONG, Reading, is_too_long, read
from llm.offline.standing import with_standings
from llm.offline.subtasks import (
    PlainTask,
    check_sizes,
    decompose,
    goal_of,
    is_possible,
    problem,
    scale_factors,
    why_unfit,
)
from llm.offline.switching import VERBS, can_switch, with_switchings
from llm.offline.words import TaggedWord, read_words
from llm.proposing.proposal import Expanded, Proposal
from oag import Action, Primitive, Scene, SimpleTask, Task, Verdict, compose, flows
from oag.model.actions import ActionFlow
from oag.sizes import TO_THE_AIM, Sizing, planned_resizings
from oag.wish_list import KINDS, AdmittedTask, OnRefusal, Wish, WishKind, ignore, wishes

_VERBS = {
    "OPEN": IntentKind.OPEN,
    "CLOSE": IntentKind.CLOSE,
    "PICK": IntentKind.PICK,
    "TAKE": IntentKind.PICK,
    "PUT": IntentKind.PLACE,
    "CLEAR": IntentKind.PLACE,
    "EMPTY": IntentKind.PLACE,
    "TIDY": IntentKind.PLACE,
}
# Wishes about one object, and the verb that asks for them.
_VERB_OF: dict[WishKind, IntentKind] = {
    "open": IntentKind.OPEN,
    "close": IntentKind.CLOSE,
    "pick": IntentKind.PICK,
    "take-out": IntentKind.PICK,
    "switch-on": IntentKind.SWITCH_ON,
    "switch-off": IntentKind.SWITCH_OFF,
    "stand-up": IntentKind.STAND,
    **dict.fromkeys(("put-into", "put-onto", "fill", "stack"), IntentKind.PLACE),
}
_SWITCHINGS = ("SWITCHON", "SWITCHOFF", "OPERATE")
_ACTIONS = frozenset({*_VERBS, *_SWITCHINGS, "SETUPRIGHT", "FORCE", "PUSH", "PULL", "WANT", "LIKE", "MUST", "CONTAIN"})
_MOST_SUGGESTIONS = 3
LONGEST_QUERY = 2_000
"""Most characters of a query; the longest readable sentence needs a quarter of them."""

# Possible codes of a refusal with unknown words; any other code rests on words that were taken for names.
_OF_WORDS: tuple[RefusalCode, ...] = ("unknown-object", "unknown-action", "not-understood", "too-long", "empty")
_MOST_STRANGERS = 4
_LONGEST_STRANGER = 60


@dataclass(frozen=True, slots=True)
class Meaning:
    """Meaning of a query: the intents in order, the goal G, the scene's state for the later modules, assumptions."""

    request: Request
    goal: bddl.Formula
    around: Surroundings
    notes: tuple[str, ...] = ()


def understand(query: str, scene: Scene, lexicon: Lexicon, sizing: Sizing = TO_THE_AIM) -> Meaning:
    """Return the intents of a query in a scene, and their goal.

    Raises:
        QueryError: The query is not understood, is ambiguous, or cannot be executed here.
    """
    if len(query) > LONGEST_QUERY:
        raise QueryError("too-long", query, f"it has {len(query)} characters, and the most are {LONGEST_QUERY}")
    grounding = Grounding.of(scene, lexicon, sizing)
    around = grounding.around
    words, manner = read_words(query, lexicon)
    if (standing := with_standings(query, grounding)) is not None:
        words, manner = standing, tuple(phrase for phrase in manner if phrase not in lexicon.upright)
    words, features = grounding.names.without_features(words)
    tokens = grounding.names.with_own_nouns(words)
    try:
        tokens, dropped = with_switchings(tokens, grounding)
        request, trusted = _of_known_words(tokens, grounding)
    except Refusal as refusal:
        # Different readings are plans already, even if part of them is fulfilled.
        readable = refusal.code == "ambiguous-reading"
        wishes: Sequence[Intent | Request] = [w for w in refusal.instead if readable or is_possible(w, around)]
        suggestions = [text for text in map(str, wishes) if not is_too_long(read_words(text, lexicon)[0])]
        suggestions = suggestions or [str(wish) for wish in islice(_nearest(tokens, grounding), _MOST_SUGGESTIONS)]
        raise QueryError(
            refusal.code,
            query,
            refusal.problem,
            understood=refusal.understood,
            scene=refusal.scene,
            suggestions=suggestions[:_MOST_SUGGESTIONS],
            among=refusal.among,
        ) from None
    notes = [f'"{phrase}" changes nothing in the plan' for phrase in (*manner, *features, *dropped)]
    notes += [*trusted, *_assumptions(request, around)]
    return Meaning(request, goal_of(request, around), around, tuple(dict.fromkeys(notes)))


def _of_known_words(tokens: Sequence[TaggedWord], grounding: Grounding) -> tuple[Request, tuple[str, ...]]:
    """Return the request of a query of known words, or raise the Refusal that names the unknown ones."""
    names = grounding.names
    runs = groupby(tokens, key=lambda token: token.terminal == "WORD" and not names.knows(token.text))
    strange = tuple(dict.fromkeys(" ".join(token.text for token in run) for unknown, run in runs if unknown))
    other: Refusal | None = None
    try:
        meant = _interpreted(tokens, grounding, trusts=not strange)
    except Refusal as refusal:
        if not strange:
            raise _beyond(tokens, grounding, refusal) from None
        other = refusal
    else:
        if not strange:
            return meant
    raise _beyond(tokens, grounding, _strange_words(strange, names, other))


def _beyond(tokens: Sequence[TaggedWord], grounding: Grounding, refusal: Refusal) -> Refusal:
    """Return a refusal with the reason why its verb is beyond every plan, such as "pour"; others as they are."""
    names = grounding.names
    if not tokens:
        return refusal
    # That the scene has no button or knob is no reason where it has one.
    known = VERBS if can_switch(grounding.around) else ()
    strange = (token.text for token in tokens if _is_beyond(token, tokens, known))
    verb = next((text for text in strange if text in names.lexicon.beyond), None)
    if verb is not None and (verb == tokens[0].text or " " in verb) and refusal.code in _OF_WORDS:
        refusal.code = "unknown-action"
    if verb is not None and refusal.code in ("unknown-action", "not-understood"):
        refusal.problem = f'"{verb}" is no action of the library: {names.lexicon.beyond[verb]}; {refusal.problem}'
    return refusal


def _is_beyond(verb: TaggedWord, tokens: Sequence[TaggedWord], known: Collection[str]) -> bool:
    """Decide whether a verb may be the reason for a refusal: to push is an action wherever it has a spot."""
    if verb.terminal != "PUSH":
        return verb.text not in known
    return is_too_long(tokens) or not any(command.kind == "push" for reading in read(tokens) for command in reading)


def _interpreted(
    tokens: Sequence[TaggedWord], grounding: Grounding, *, trusts: bool
) -> tuple[Request, tuple[str, ...]]:
    if not any(token.terminal not in ("COMMA", "STOP") for token in tokens):
        raise Refusal("empty", "it asks for nothing")
    if is_too_long(tokens):
        raise Refusal("too-long", f"it is too long: {TOO_LONG}; ask for a few things in short sentences")
    readings = read(tokens)
    if not readings:
        raise _unreadable(tokens, grounding)
    try:
        return interpret(readings, grounding)
    except Refusal as refusal:
        if refusal.leaves_choice or not trusts:
            raise
        try:
            return interpret(readings, replace(grounding, trusts=True))
        except Refusal:
            raise refusal from None


def interpret(readings: Sequence[Reading], grounding: Grounding) -> tuple[Request, tuple[str, ...]]:
    """Return the one request that the readings (at least one) allow in the scene, and the assumptions."""
    found: dict[Request, tuple[str, ...]] = {}
    liked: dict[Request, tuple[str, ...]] = {}
    refusals: list[Refusal] = []
    taken: set[str] = set()
    for reading in readings:
        try:
            request, notes = interpret_reading(reading, grounding)
        except Refusal as refusal:
            refusal.in_vain = any(command.kind in ("bare", "nowhere", "away", "liked") for command in reading)
            refusal.understood = refusal.understood or "; ".join(str(command) for command in reading)
            refusals.append(refusal)
        else:
            (liked if any(command.kind == "liked" for command in reading) else found).setdefault(request, notes)
            if any(command.kind == "pick" for command in reading):
                taken.update(intent.target for intent in request.intents)
    # Nothing is put closest to a thing: what is liked there can only be named.
    found = found if found or refusals else liked
    sources = {step.object_id for key in taken for step in grounding.around.supports(key)}
    undecided = [refusal for refusal in refusals if refusal.leaves_choice and not _is_decided(refusal, found, sources)]
    if undecided and not found and all(_names_one(refusal, liked) for refusal in undecided):
        request, notes = next(iter(liked.items()))
        note = f"where {request.intents[0].target} is tells which one is meant, and not where it shall be"
        return request, (*notes, note)
    if found and not undecided:
        found = _without_looser(_without_detours(found))
        if len(found) == 1:
            return next(iter(found.items()))
        raise Refusal("ambiguous-reading", "it can be read in more than one way", instead=tuple(found))
    raise max(undecided or refusals, key=lambda refusal: refusal.progress)


def _without_detours(found: Mapping[Request, tuple[str, ...]]) -> dict[Request, tuple[str, ...]]:
    """Return requests without those that end like another one, and put things down in more places on the way.

    "Take the cup on the cabinet off the cabinet and put it on the oven" puts nothing onto the cabinet.
    """
    ends = {request: {intent.target: intent for intent in request.intents} for request in found}
    return {
        request: notes
        for request, notes in found.items()
        if not any(ends[other] == ends[request] and len(other.intents) < len(request.intents) for other in found)
    }


def _without_looser(found: Mapping[Request, tuple[str, ...]]) -> dict[Request, tuple[str, ...]]:
    """Return requests without those that another one fulfils as well, and says the spots of.

    "Place the bowl beside the book on the sofa" puts it onto the sofa by each reading, and by one beside the book.
    """

    def fulfils(closer: Request, looser: Request) -> bool:
        pairs = tuple(zip(closer.intents, looser.intents, strict=False))
        same = all(near == far or replace(near, where=None) == far for near, far in pairs)
        return closer != looser and len(closer.intents) == len(looser.intents) and same

    return {request: notes for request, notes in found.items() if not any(fulfils(other, request) for other in found)}


def _is_decided(refusal: Refusal, found: Collection[Request], sources: Collection[str]) -> bool:
    """Decide whether the only other reading says which one is meant: "the glass on the table" of several glasses.

    "Get the glass on the table" says it of several tables, too: `sources` are those that a glass is taken from.
    """
    if refusal.code != "ambiguous-object" or len(found) != 1:
        return False
    (request,) = found
    spoken = {
        key for i in request.intents for key in (i.target, i.destination, None if i.where is None else i.where.other)
    }
    return bool(spoken.union(sources).intersection(refusal.among))


def _names_one(refusal: Refusal, liked: Collection[Request]) -> bool:
    """Decide whether "I'd like the die on the oven" can only name a die: put there, it could be any of several."""
    targets = {intent.target for request in liked for intent in request.intents}
    return refusal.code == "ambiguous-object" and len(targets) == 1 and not targets.isdisjoint(refusal.among)


def _unreadable(tokens: Sequence[TaggedWord], grounding: Grounding) -> Refusal:
    limit = next((token.text for token in tokens if token.terminal == "LIMIT"), None)
    if limit is not None:
        problem = f'"{limit}" limits, turns or asks something, and the offline planner reads plain wishes only'
        return Refusal("not-understood", problem)
    if not any(token.terminal in _ACTIONS for token in tokens):
        unknown = [token.text for token in tokens if token.terminal == "WORD"]
        unnamed = [word for word in unknown if not grounding.names.mentioned((word,))]
        phrases = ((phrase, verb) for verb in _VERBS for phrase in grounding.names.lexicon.phrases(verb))
        verbs = {phrase: verb for phrase, verb in phrases if not phrase.endswith("ing")}
        near = [name for word in unnamed for name in bddl.near_names(word, verbs)]
        return no_action(tuple({verbs[name]: name for name in reversed(near)}.values())[::-1])
    understood = " ".join(token.text for token in tokens)
    return Refusal("not-understood", "it knows every word, but no sentence of this form", understood=understood)


def _strange_words(strange: Sequence[str], names: Names, other: Refusal | None) -> Refusal:
    """Return the refusal that names unknown words: no part of any name in scene or lexicon."""
    words = [word for run in strange for word in run.split()]
    strange = [run if len(run) <= _LONGEST_STRANGER else f"{run[:_LONGEST_STRANGER]}..." for run in strange]
    listed = [f'"{run}"' for run in strange[:_MOST_STRANGERS]]
    listed += [f"{len(strange) - _MOST_STRANGERS} more"] if len(strange) > _MOST_STRANGERS else []
    unknown = f"it does not know {enumeration(listed)}"
    code = other.code if other is not None and other.code in _OF_WORDS else "not-understood"
    if any(word in names.lexicon.foreign or (word.isalpha() and not word.isascii()) for word in words):
        problem = f"the offline planner reads English only, and does not know {enumeration(listed)}"
        return Refusal(code, f"{problem}; a language model may know other languages")
    if names.lexicon.people.issuperset(words):
        problem = f"nothing can be handed to {enumeration(listed)}; ask to pick it up, or say where it shall go"
        return Refusal("not-understood", problem)
    if not any(map(str.isalnum, "".join(words))):
        code = "not-understood"
    if code == "unknown-object":
        meant = names.meant(*strange[:_MOST_STRANGERS])
        unknown = f"nothing in {names.scene.name} is called {' or '.join(listed)}{meant}"
    elif other is not None and code == other.code and code != "not-understood":
        unknown = f"{unknown}; {other.problem}"
    return Refusal(code, unknown, scene=other.scene if other is not None and code == other.code else ())


def _nearest(tokens: Sequence[TaggedWord], grounding: Grounding) -> Iterator[Wish]:
    """Yield the wishes that the scene admits, those nearest to the query's words first.

    If the query has a subject, an item to move or a thing to open, with any feasible wish, all results are about it:
    suggestions about another object do not help.
    """
    around, mentioned = grounding.around, grounding.names.mentioned(tuple(token.text for token in tokens))
    verbs = {_VERBS[token.terminal] for token in tokens if token.terminal in _VERBS}
    objects = around.scene.objects

    def is_subject(key: str) -> bool:
        if verbs and all(verb.is_about_a_door for verb in verbs):
            return around.affordances[key].door
        return objects[key].role == "B"

    order = {key: number for number, key in enumerate(objects)}

    def distance(wish: Wish) -> tuple[bool, bool, int, int, int]:
        named = {*wish.targets, wish.place} - {None}
        kinds = [objects[key].category for key in named if key is not None]
        # Putting an object into another of its kind is possible but hardly ever meant.
        alike = len(set(kinds)) < len(kinds)
        where = order[wish.targets[0]], order.get(wish.place or "", -1)
        return alike, _VERB_OF[wish.kind] not in verbs, -len(named & set(mentioned)), *where

    about = set(mentioned or objects)
    single = wishes(around.scene, tuple(_VERB_OF), sizing=around.sizing)
    ordered = sorted((wish for wish in single if about & {*wish.targets, wish.place}), key=distance)
    subject = next(filter(is_subject, mentioned), None)
    own = [wish for wish in ordered if subject in wish.targets and _can_be_done(wish, around)]
    yield from own or (wish for wish in ordered if _can_be_done(wish, around))


def _can_be_done(wish: Wish, around: Surroundings) -> bool:
    return is_possible(Intent(_VERB_OF[wish.kind], wish.targets[0], wish.relation, wish.place), around)


def _assumptions(request: Request, around: Surroundings) -> list[str]:
    """Return the assumptions and side effects of the plan where scene or hand leave no choice."""
    notes: list[str] = []
    state = around
    opened: set[str] = set()
    for intent in request.intents:
        if not state.fulfils(intent):
            notes += _assumed(intent, state, opened)
        if intent.kind is IntentKind.OPEN:
            opened.add(intent.target)
        state = state.after(intent)
    if len(request.intents) > 1:
        last = {intent.target: intent.kind for intent in request.intents if intent.kind.is_about_a_door}
        entered = {intent.destination for intent in request.intents}
        left_open = [door for door, kind in last.items() if kind is IntentKind.OPEN and door in entered]
        notes += [f"{door} stays open, since no wish closes it again" for door in left_open]
    return notes


def _assumed(intent: Intent, state: Surroundings, opened: Collection[str]) -> list[str]:
    """Return the assumptions and side effects of one intent; `opened` are doors that earlier intents opened."""
    doors = state.doors_in_the_way(intent)
    asked = (*doors, *((intent.target,) if intent.kind.is_about_a_door else ()))
    unknown = [door for door in asked if state.is_open(door) is None]
    notes = [f"the scene does not say whether {door} is open; it is planned as closed" for door in unknown]
    if intent.kind is IntentKind.PICK:
        notes += [f"{door} stays open, since the hand holds {intent.target} at the end" for door in doors]
    destination = intent.destination if intent.relation == "inside" else None
    if destination is not None and destination not in (*doors, *opened) and state.affordances[destination].door:
        notes.append(f"{destination} is open and is left as it was found")
    cargo = state.cargo(intent.target) if intent.kind.moves_an_item else ()
    if cargo:
        stand, move = ("stands", "moves") if len(cargo) == 1 else ("stand", "move")
        notes.append(f"{enumeration(cargo)} {stand} in or on {intent.target} and {move} along with it")
    return notes


_ORDINALS = ("First", "Second", "Third", "Fourth", "Fifth", "Sixth", "Seventh", "Eighth", "Ninth", "Tenth")
_NAME_PREPOSITION = {"inside": "into", "ontop": "on"}


@dataclass(frozen=True, slots=True)
class OfflinePlanner:
    """Propose tasks without a model; equal queries and scenes give equal proposals.

    Attributes:
        lexicon: Known words and categories; `llm.offline.lexicon.load` reads another one from a file.
        sizing: Rule for the sizes of manipulated objects.
    """

    lexicon: Lexicon = field(default_factory=built_in)
    sizing: Sizing = TO_THE_AIM

    def propose(self, query: str, scene: Scene) -> Proposal:
        """Return the task for a query in a scene.

        Raises:
            QueryError: The query is not understood, is ambiguous, or cannot be executed in the scene. Code
                "too-large": an object would have to be scaled too much. Code "unproved": the plan cannot succeed.
        """
        understood = understand(query, scene, self.lexicon, self.sizing)
        around, request = understood.around, understood.request
        wanted = str(request)
        steps = decompose(request, around)
        lifted = tuple(step.target for step in steps if step.kind is not IntentKind.PUSH)
        check_sizes(lifted, scene, self.sizing, query, wanted, _pushes_instead(request, around))
        subtasks = tuple(_subtask(step, around) for step in steps)
        detail = _narrative(request, steps, around)
        task = Task(
            name=_task_name(request, steps, around),
            detail=detail,
            goal=understood.goal,
            goal_given=True,
            subtasks=subtasks,
            scales=scale_factors(lifted, scene, self.sizing),
            scene=scene,
        )
        # Unknown facts of the scene do not refute a plan.
        report = compose(task).verify()
        if report.verdict is Verdict.REFUTED:
            reason = f"no plan was found for it that goes through: {report.errors[0].message}"
            raise QueryError("unproved", query, reason, understood=wanted)
        return Proposal(
            query=query,
            expanded=Expanded(wanted, detail),
            task=task,
            problems=tuple(problem(subtask.name, subtask.init, subtask.goal, scene) for subtask in subtasks),
            notes=(*understood.notes, *map(str, planned_resizings(task.scales, scene))),
        )


def _pushes_instead(request: Request, around: Surroundings) -> tuple[str, ...]:
    """Return the wishes to push what is to be put beside another thing, and is wider than the hand opens."""
    at_spots = (i for i in request.intents if i.kind is IntentKind.PLACE and i.where is not None and i.where.other)
    unfit = (i for i in at_spots if why_unfit(i.target, around.scene, around.sizing) is not None)
    pushes = (replace(intent, kind=IntentKind.PUSH) for intent in unfit)
    return tuple(str(push) for push in pushes if is_possible(push, around))


def _subtask(step: PlainTask, around: Surroundings) -> SimpleTask:
    init, goal = step.states()
    name = f"{step.kind.value.replace(' ', '_')}_{_noun(step.target, around)}"
    if step.end is not None:
        name += f"_{_NAME_PREPOSITION[step.end.relation]}_{_noun(step.end.object_id, around)}"
    return SimpleTask(
        name=name,
        detail=_subtask_detail(step, around),
        target=step.target,
        support_init=None if step.start is None else step.start.object_id,
        support_goal=None if step.end is None else step.end.object_id,
        init=init,
        goal=goal,
        flow=_flow(step, around),
        where=step.where,
    )


def _flow(step: PlainTask, around: Surroundings) -> ActionFlow | None:
    """Return the flow of a simple task; None where it takes a primitive that the scene's domain does not have."""
    if step.kind is IntentKind.STAND:
        own = around.scene.domain.primitive("SET_UPRIGHT")
        before, release = (tuple(map(Action, part)) for part in (flows.PLACE[:-2], flows.PLACE[-2:]))
        return None if own is None else (*before, Action(own), *release)
    if not step.kind.is_a_switching:
        return step.flow(around.scene)
    verb = "PRESS" if around.control(step.target) == "button" else "TURN"
    own = around.scene.domain.primitive(f"{verb}_{'ON' if step.kind is IntentKind.SWITCH_ON else 'OFF'}")
    return None if own is None else (Action(own), Action(Primitive.RETREAT))


def _stem(object_id: str) -> str:
    return object_id.rstrip("0123456789").rstrip("_")


def _noun(object_id: str, around: Surroundings) -> str:
    """Return the id without its number if that is unique in the scene: "glass" for `glass_0`."""
    stem = _stem(object_id)
    alike = [key for key in around.scene.objects if _stem(key) == stem]
    return stem if stem and len(alike) == 1 else object_id


def _task_name(request: Request, steps: Sequence[PlainTask], around: Surroundings) -> str:
    """Return the activity name of the whole task; it includes opening doors, but not closing them on the way.

    Source: the form of the paper's own, such as `open_the_refrigerator_and_put_the_glass_into_the_refrigerator`.
    """
    wished = {intent.target for intent in request.intents if intent.kind is IntentKind.OPEN}
    on_the_way = dict.fromkeys(step.target for step in steps if step.kind is IntentKind.OPEN)
    parts = [f"open_the_{_noun(door, around)}" for door in on_the_way if door not in wished]
    return "_and_".join((*parts, *(_wish_name(group, around) for group in request.groups())))


def _wish_name(group: Sequence[Intent], around: Surroundings) -> str:
    first = group[0]
    targets = "_and_".join(f"the_{_noun(intent.target, around)}" for intent in group)
    name = f"{first.kind.value.replace(' ', '_')}_{targets}"
    if first.relation is None or first.destination is None:
        return name
    return f"{name}_{_NAME_PREPOSITION[first.relation]}_the_{_noun(first.destination, around)}"


def _subtask_detail(step: PlainTask, around: Surroundings) -> str:
    target, start, end = step.target, step.start, step.end
    if step.kind.is_about_a_door:
        front = "drawer" if around.affordances[target].opens_by("drawer") else "door"
        does, moves = (
            ("Open", f"pull the {front} open") if step.kind is IntentKind.OPEN else ("Close", f"push the {front} shut")
        )
        way = f"drive to it, take hold of its handle and {moves}, then let go and withdraw the hand."
        return f"{does} {target}: {way}"
    if step.kind.is_a_switching:
        part = around.control(target)
        how = "press it through its travel" if part == "button" else "take hold of it, turn it, and let go"
        return f"{step.kind.value.capitalize()} {target}: drive to its {part}, {how}, then withdraw the hand."
    if step.kind is IntentKind.PUSH:
        way = "drive to it, bring the hand down behind it, press it straight on, then withdraw the hand."
        return f"Push {target} {step.where}: {way}"
    if end is None:
        clear = "lift it and back out with it" if start is not None and start.relation == "inside" else "lift it clear"
        place = "" if start is None else f" {_from(start)}"
        return f"Pick up {target}{place}: drive to it, reach for it, grasp it and {clear}."
    where = "inside" if end.relation == "inside" else "on top of"
    if step.kind is IntentKind.STAND:
        return (
            f"Stand {target} up {end}: turn the hand so that what lay is upright, lower it until it stands there, "
            "then let go and withdraw the hand."
        )
    return (
        f"Put {target} {PREPOSITION[end.relation]} {end.object_id}: carry it there, move forward, "
        f"lower it until it stands {where} {end.object_id}, then let go and withdraw the hand."
    )


def _narrative(request: Request, steps: Sequence[PlainTask], around: Surroundings) -> str:
    places = [(step.target, *(s.object_id for s in (step.start, step.end) if s is not None)) for step in steps]
    involved = dict.fromkeys(key for ids in places for key in ids if key in around.scene.objects)
    sentences = [f"The scene is {around.scene.name}.", *(_setting(key, around) for key in involved)]
    sentences.append(f"The task is to {request}.")
    for index, step in enumerate(steps):
        ordinal = _ORDINALS[index] if index < len(_ORDINALS) else "Then"
        ordinal = "Finally" if index == len(steps) - 1 else ordinal
        sentences.append(f"{'The' if len(steps) == 1 else f'{ordinal}, the'} robot {_action(step)}.")
    return " ".join(sentences)


def _setting(object_id: str, around: Surroundings) -> str:
    thing = around.scene.objects[object_id]
    name = object_id if _stem(object_id) == thing.category else f"{object_id} ({thing.category})"
    place = around.support(object_id) or around.bearing(object_id)
    state = around.is_open(object_id) if around.affordances[object_id].door else None
    state_text = "" if state is None else f", and it is {'open' if state else 'closed'}"
    return f"{name} is {place}{state_text}."


def _from(support: Support) -> str:
    return f"{'out of' if support.relation == 'inside' else 'from'} {support.object_id}"


def _action(step: PlainTask) -> str:
    if step.kind.is_about_a_door:
        return f"{step.kind.value}s {step.target} by its handle"
    if step.kind.is_a_switching:
        return f"{step.kind.value.replace('switch', 'switches')} {step.target}"
    if step.kind is IntentKind.PUSH:
        return f"pushes {step.target} {step.where}"
    if step.kind is IntentKind.STAND and step.end is not None:
        return f"stands {step.target} up {step.end} and lets go of it"
    if step.end is None:
        return f"picks up {step.target}" + ("" if step.start is None else f" {_from(step.start)}")
    return f"puts {step.target} {PREPOSITION[step.end.relation]} {step.end.object_id} and lets go of it"


def tasks(
    scene: Scene,
    kinds: Collection[WishKind] = KINDS,
    *,
    sizing: Sizing = TO_THE_AIM,
    on_refusal: OnRefusal = ignore,
) -> Iterator[AdmittedTask]:
    """Yield the wishes that a scene admits, with sentences and plans of the offline planner.

    Each sentence is read back to a goal that is equivalent to the wish's. Arguments are those of `oag.tasks`.
    """
    offline = OfflinePlanner(sizing=sizing)

    def planner(sentence: str) -> Task | None:
        try:
            return offline.propose(sentence, scene).task
        except QueryError:
            return None

    return oag.tasks(scene, kinds, planner=planner, sizing=sizing, on_refusal=on_refusal)
