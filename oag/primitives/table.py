"""The symbolic table of the 21 primitives: their preconditions and intended effects, and the invariants of states.

Everything that reasons about plans (`verify`, `recheck`, regression, the docs) reads this one table. An effect is a map
from facts to values: a primitive cannot both delete and add a fact. What is not written keeps its value.

Invariants: `ontop` and `inside` are irreflexive and antisymmetric; what has no joint is not open; what has no inside
contains nothing. That hand, arm and base have one state each follows from the form of facts (`oag.model.symbols`).

Source: the paper's primitive library (Module 5, 3.1 to 3.4). The departures are explained in docs/semantics.md, The
primitives: GRASP needs the fixture that holds the item to be open. UNGRASP drops nothing outside its subtask. Carrying
an item makes `nextto`, `touching` and `under` of it unknown. Numbers can say that nothing moves. Invariants: States.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from functools import cache
from itertools import product
from typing import NamedTuple

import bddl
from oag.model.domain import BUILT_IN, LAST_BUILT_IN, Domain, Own, bound, own_of
from oag.model.symbols import (
    ANY,
    ARTICULATIONS,
    EEF,
    EMPTY,
    FREE,
    GRIPPER,
    HAND,
    HOME,
    MAX_JOINT_LIMIT,
    NEAR,
    Condition,
    Fact,
    Parameter,
    Primitive,
    Value,
    condition_of,
    gripping,
    has_inside,
    held_by,
    holding,
)
from oag.primitives.cargo import (
    NOTHING_CARRIED,
    RESTING,
    VAGUE,
    Carriage,
    Load,
    Reader,
    towers,
)

# One alternative must hold; most clauses have exactly one.
Clause = tuple[Condition, ...]
# Clauses that must all hold (of one condition each, for a conjunction of literals), or a formula beyond that.
Needed = tuple[Clause, ...] | bddl.Formula
Effect = tuple[tuple[Fact, Value], ...]
# What is done: a kind, a thing, and a place or None.
Deed = tuple[str, str, str | None]
# What a primitive needs, and what it writes.
Row = tuple[tuple[Clause, ...], Effect]

NAVIGATION = (Primitive.NAVIGATE_TO_TARGET, Primitive.NAVIGATE_TO_SUPPORT)
# A fixture is open from this fraction of its joint's range on, which is how the detectors read it.
OPEN_FRACTION = 0.05
# Items out of which a lift takes things; a drinking glass holds nothing that is taken out.
_OPEN_AT_TOP = frozenset(["bowl", "cup", "mug", "box", "basket", "bucket", "pan", "pot", "tray"])

# Primitives that take what is held out of every place, a compartment too.
_LEAVING = frozenset(
    (
        Primitive.RETREAT,
        *NAVIGATION,
        Primitive.MOVE_BASE_FORWARD,
        Primitive.MOVE_BASE_BACKWARD,
        Primitive.MOVE_BASE_LEFT,
        Primitive.MOVE_BASE_RIGHT,
    )
)
# Primitives that keep the hand in place, or move it with a handle, which is no held item.
_IN_PLACE = (Primitive.GRASP, Primitive.UNGRASP, *ARTICULATIONS)
_EMPTY_HAND: Clause = (Condition(HAND, EMPTY),)
_AT_HOME: tuple[Fact, Value] = (EEF, HOME)
_FREED: Effect = ((EEF, FREE),)
_EMPTIED: Effect = ((HAND, EMPTY),)


class Placement(NamedTuple):
    """Where a goal wants the target: `relation` is ontop or inside."""

    relation: str
    support: str


class Context(NamedTuple):
    """Objects of a subtask that decide, with the state, what a primitive needs and writes.

    Attributes:
        target: The subtask's target (o_t).
        support_goal: Its goal support (o_s2), or None.
        placement: Where its goal wants the target, or None.
        target_is_item: True when GRASP takes the target into the hand, False when it grips a fixture's handle.
        articulated: Ids of the scene's articulated fixtures, in order.
        vessels: Ids of its items that are open at the top, in order.
        carriage: Who may carry whom in the plan, and what may be inside what.
    """

    target: str
    support_goal: str | None
    placement: Placement | None
    target_is_item: bool
    articulated: tuple[str, ...]
    vessels: tuple[str, ...] = ()
    carriage: Carriage = NOTHING_CARRIED

    @property
    def carried(self) -> frozenset[str]:
        """The things whose places change; all others are where the start has them."""
        return frozenset(name for name, _ in self.carriage.riders) | frozenset(
            name for _, riders in self.carriage.riders for name in riders
        )

    @property
    def names(self) -> tuple[str, ...]:
        """The objects that the subtask is about."""
        return (self.target,) if self.support_goal is None else (self.target, self.support_goal)


class Rows:
    """The rows of the table for one context, each computed once.

    Attributes:
        context: The objects that they are about.
        carries: True when something in the plan may carry another thing, or be inside another place.
    """

    __slots__ = ("_known", "carries", "context")

    def __init__(self, context: Context) -> None:
        self.context = context
        self.carries = context.carriage != NOTHING_CARRIED
        self._known: dict[tuple[Primitive, Value, Parameter], Row] = {}

    def row(self, primitive: Primitive, hand: Value, parameter: Parameter = None) -> Row:
        """Return the needs and the writes of a primitive with its number, for a value of the hand before it."""
        key = (primitive, hand, parameter)
        known = self._known.get(key)
        if known is None:
            known = self._known[key] = _row(primitive, self.context, hand, parameter)
        return known

    def written(self, primitive: Primitive, hand: Value, parameter: Parameter, read: Reader) -> Effect:
        """Return the writes of a primitive, those about what the held item carries included.

        `read` gives what the start and the steps before make of a fact, without anything that is assumed.
        """
        plain = self.row(primitive, hand, parameter)[1]
        return plain + cargo(primitive, self.context, hand, parameter, read) if self.carries else plain


def needed(formula: bddl.Formula) -> Needed:
    """Return a formula's literals as clauses, or the formula when it is no conjunction of literals."""
    literals = bddl.literals(formula)
    return formula if literals is None else clauses_of(literals)


def clauses_of(literals: Iterable[bddl.Literal]) -> tuple[Clause, ...]:
    """Return literals as clauses of one condition each."""
    return tuple([(condition_of(atom, value),) for atom, value in literals])


def placement_of(goal: bddl.Formula, target: str) -> Placement | None:
    """Return where a goal wants its target: the first positive `ontop` or `inside` literal among its conjuncts."""
    for part in bddl.conjuncts(goal):
        while isinstance(part, bddl.Not) and isinstance(part.body, bddl.Not):
            part = part.body.body
        if not isinstance(part, bddl.Atom) or part.predicate not in RESTING or len(part.args) != 2:
            continue
        thing, place = part.args
        if thing == target and place != GRIPPER:
            return Placement(part.predicate, place)
    return None


def placement_among(clauses: Iterable[Clause], target: str) -> Placement | None:
    """Return the place of the target in a goal of these clauses; being in the gripper is no place."""
    for (fact, _, positive), *_ in clauses:
        if positive and len(fact) == 3 and fact[0] in RESTING and fact[1] == target and fact[2] != GRIPPER:
            return Placement(fact[0], fact[2])
    return None


def does(
    deed: Deed,
    target: str,
    placement: tuple[str, str] | None,
    primitives: Container[Primitive],
    own: Container[Deed] = (),
) -> bool:
    """Decide whether a subtask does something: a kind, a thing, and a place (`oag.model.infeasible`).

    Its target, where its goal puts that, its flow's primitives, and what `own` ones do (`own_deeds`) decide.
    """
    if deed in own:
        return True
    kind, thing, place = deed
    done_by = _DONE_BY.get(kind)
    return thing == target and (placement == (kind, place) if done_by is None else done_by in primitives)


_DONE_BY = {"take": Primitive.GRASP, "open": Primitive.ARTICULATE_OPEN, "close": Primitive.ARTICULATE_CLOSE}


def guarded(init: Needed, impossible: Iterable[tuple[Clause, ...]]) -> Needed:
    """Return an initial condition that also asks that some literal of each of these conjunctions is false."""
    denied = [tuple(c._replace(positive=not c.positive) for (c,) in circumstances) for circumstances in impossible]
    if isinstance(init, tuple) or not denied:
        return (*init, *denied) if isinstance(init, tuple) else init
    parts = (bddl.Or(tuple(each for c in clause if (each := c.literal()) is not None)) for clause in denied)
    return bddl.And((init, *parts))


def open_at_top(category: str) -> bool:
    """Decide whether a lift takes things out of an item of a category, such as a bowl."""
    return category.lower().split(".", 1)[0].replace("-", "_").rpartition("_")[2] in _OPEN_AT_TOP


def requirements(primitive: Primitive, context: Context, hand: Value) -> tuple[Clause, ...]:
    """Return the clauses that must all hold before a primitive runs; only UNGRASP depends on the hand."""
    return _row(primitive, context, hand, None)[0]


def carries(primitive: Primitive, parameter: Parameter = None) -> bool:
    """Decide whether a primitive carries what the hand holds; all do that move the hand or the base."""
    return primitive not in _IN_PLACE and parameter != 0.0


def effect(primitive: Primitive, context: Context, hand: Value, parameter: Parameter = None) -> Effect:
    """Return what the intended outcome of a primitive writes, as pairs (fact or pattern, value), no fact twice.

    A pattern does not touch a fact that is listed itself. For an unknown hand every resting place becomes unknown where
    the primitive would have moved what is held. A parameter of None is filled in by the executor, or takes no number.
    """
    return _row(primitive, context, hand, parameter)[1]


def _row(primitive: Primitive, context: Context, hand: Value, parameter: Parameter) -> Row:
    if primitive > LAST_BUILT_IN:
        own = own_of(primitive)
        assert own is not None
        return _own_row(own, context)
    if parameter is None:
        return _TABLE[primitive](context, hand)
    if primitive in ARTICULATIONS and isinstance(parameter, tuple):
        return _TABLE[primitive](context, hand)[0], _articulated(primitive, context.target, *parameter)
    # A motion by 0 moves nothing.
    return _TABLE[primitive](context, hand) if parameter != 0.0 or primitive in _IN_PLACE else ((), ())


def _own_row(own: Own, context: Context) -> Row:
    """Return the row of an own domain; what it puts somewhere goes nowhere that is shut, nor on what it carries."""
    needs, writes = bound(own, context.target, context.support_goal)
    if not own.row.robot:
        return needs, writes
    for thing, place in _moved_out(writes):
        around = context.articulated if place == ANY else (place,) if place in context.articulated else ()
        if thing == ANY:
            needs += tuple((Condition(("open", fixture), True),) for fixture in around)
        else:
            needs += tuple(
                (Condition(("inside", thing, fixture), True, False), Condition(("open", fixture), True))
                for fixture in around
                if fixture != thing
            )
    for relation, thing, place in _places(writes):
        if relation == "inside" and place in context.articulated:
            needs += ((Condition(("open", place), True),),)
        chains = towers(context.carriage, place, thing)
        needs += _uncovered(context, place)
        needs += tuple(tuple(Condition(fact, True, False) for fact in chain) for chain in chains)
    return needs, writes


def _moved_out(writes: Effect) -> Iterator[tuple[str, str]]:
    """Yield what a row moves, with what it is taken out of, both perhaps `ANY`."""
    for fact, value in writes:
        held = held_by(value) if fact == HAND else None
        if held is not None:
            yield held, ANY
        elif len(fact) == 3 and fact[0] in RESTING:
            yield fact[1], ANY if value is True else fact[2]


def own_deeds(primitives: Iterable[Primitive], target: str, support: str | None) -> frozenset[Deed]:
    """Return what primitives of an own domain do in a subtask, by what their rows write."""
    found: set[Deed] = set()
    for own in (own for own in map(own_of, primitives) if own is not None and own.row.robot):
        writes = bound(own, target, support).writes
        found.update(_places(writes))
        for fact, value in writes:
            if fact[0] == "open" and value is not None:
                found.add(("open" if value else "close", fact[1], None))
            elif fact == HAND and (item := held_by(value)) is not None:
                found.add(("take", item, None))
    return frozenset(found)


def own_places(primitives: Iterable[Primitive], target: str, support: str | None) -> tuple[tuple[str, str, str], ...]:
    """Return where primitives of an own domain put things in a subtask."""
    rows = [own for own in map(own_of, primitives) if own is not None and own.row.robot]
    return tuple(fact for own in rows for fact in _places(bound(own, target, support).writes))


def _places(writes: Effect) -> tuple[tuple[str, str, str], ...]:
    put = (fact for fact, value in writes if value is True and len(fact) == 3 and fact[0] in RESTING)
    return tuple((relation, thing, place) for relation, thing, place in put)


def _own_cargo(own: Own, context: Context, read: Reader) -> Effect:
    """Return what a row writes about the cargo of what it moves."""
    writes = bound(own, context.target, context.support_goal).writes
    places: dict[str, dict[Fact, Value]] = {}
    for relation, thing, place in _places(writes):
        places[thing] = Load(context.carriage, thing, read).set_down(relation, place)
    moved = (fact[1] for fact, value in writes if value is not True and len(fact) == 3 and fact[0] in RESTING)
    for thing in dict.fromkeys(moved):
        if thing not in places and thing != ANY:
            places[thing] = Load(context.carriage, thing, read).carried_off(lambda _: False)
    own_facts = {fact for fact, _ in writes}
    followed = {fact: value for found in places.values() for fact, value in found.items()}
    followed.update(_neighbours(writes, context, read))
    return tuple((fact, value) for fact, value in followed.items() if fact not in own_facts)


def _neighbours(writes: Effect, context: Context, read: Reader) -> dict[Fact, Value]:
    """Return what a row leaves open about the neighbours of cargo: its carrier got other ones, or may have."""
    found: dict[Fact, Value] = {}
    for fact, _ in writes:
        if len(fact) == 3 and fact[0] in VAGUE:
            moved = ((name, *Load(context.carriage, name, read).riding) for name in fact[1:])
            found.update(((fact[0], one, other), None) for one, other in product(*moved))
    return found


def _articulated(primitive: Primitive, target: str, low: float, high: float) -> Effect:
    """Return the writes of moving a joint to limits: OPEN ends at the upper one, CLOSE shuts by their distance.

    CLOSE does not go below the lower limit, and does nothing when the two are equal.

    Source: docs/departures.md, Primitives and flows; the executor reads the numbers in the same way.
    """
    ends_open = _is_open(high, high) if primitive is Primitive.ARTICULATE_OPEN else _is_open(low, high)
    stays = primitive is Primitive.ARTICULATE_CLOSE and low == high and ends_open is False
    return () if stays else ((("open", target), ends_open),)


def _is_open(limit: float, upper: float) -> bool | None:
    """Decide whether a joint at a limit is open: None when that depends on its range, which is unknown here.

    Limits are fractions when the upper one is at most 1, else radians or metres.
    """
    if upper <= 1.0 or limit <= 0.0:
        return limit > OPEN_FRACTION
    return True if limit > OPEN_FRACTION * MAX_JOINT_LIMIT else None


def _navigate_to_target(context: Context, hand: Value) -> Row:
    return (), ((NEAR, context.target), _AT_HOME) + _carried(hand)


def _navigate_to_support(context: Context, hand: Value) -> Row:
    return (), ((NEAR, context.support_goal), _AT_HOME) + _carried(hand)


def _approach(context: Context, hand: Value) -> Row:
    target = context.target
    return ((Condition(NEAR, target),),), ((EEF, f"before {target}"),) + _moved(context, hand)


def _converge(context: Context, hand: Value) -> Row:
    target = context.target
    return ((Condition(EEF, f"before {target}"),),), ((EEF, f"at {target}"),) + _moved(context, hand)


def _grasp(context: Context, _hand: Value) -> Row:
    target = context.target
    needs = ((Condition(EEF, f"at {target}"),), _EMPTY_HAND)
    if context.target_is_item:
        return needs + _reachable(context), ((HAND, holding(target)),)
    return needs + _uncovered(context, target), ((HAND, gripping(target)),)


def _reachable(context: Context) -> tuple[Clause, ...]:
    """Return the clauses that an item is in no closed fixture."""
    return tuple(
        (Condition(("inside", context.target, fixture), True, False), Condition(("open", fixture), True))
        for fixture in context.articulated
    )


def _uncovered(context: Context, name: str) -> tuple[Clause, ...]:
    """Return the clauses that nothing is closed around a thing; furniture stays where the start has it."""
    around = [place for place in context.carriage.around(name) if place in context.articulated]
    if name in context.carried:
        return tuple(
            (Condition(("inside", name, place), True, False), Condition(("open", place), True)) for place in around
        )
    return tuple((Condition(("open", place), True),) for place in around)


def _articulate_open(context: Context, _hand: Value) -> Row:
    target = context.target
    return ((Condition(HAND, gripping(target)),),), ((("open", target), True),)


def _articulate_close(context: Context, _hand: Value) -> Row:
    target = context.target
    return ((Condition(HAND, gripping(target)),),), ((("open", target), False),)


def _ungrasp(context: Context, hand: Value) -> Row:
    written = _EMPTIED + _released(context, hand)
    kept = _kept(context, hand)
    if context.placement is None or not (hand is None or held_by(hand) == context.target):
        return kept, written
    relation, support = context.placement
    # For an unknown hand, it is needed only if the hand holds the target.
    other: Clause = (Condition(HAND, holding(context.target), False),) if hand is None else ()
    needs: tuple[Clause, ...] = ((Condition(NEAR, support),),)
    if relation == "inside" and support in context.articulated:
        needs += ((Condition(("open", support), True),),)
    needs += _uncovered(context, support)
    # The target does not carry what it is put on or in.
    chains = towers(context.carriage, support, context.target)
    needs += tuple(tuple(Condition(fact, True, False) for fact in chain) for chain in chains)
    return (*kept, *(other + clause for clause in needs)), written


def _kept(context: Context, hand: Value) -> tuple[Clause, ...]:
    """Return the clauses that the hand holds no object outside the subtask: it would fall."""
    if hand is None:
        handles = dict.fromkeys((context.target, *context.articulated))
        return (tuple(Condition(HAND, v) for v in (EMPTY, holding(context.target), *map(gripping, handles))),)
    held = held_by(hand)
    return () if held is None or held == context.target else ((Condition(HAND, holding(held), False),),)


def _retreat(_context: Context, hand: Value) -> Row:
    return (), (_AT_HOME,) + _carried(hand)


def _move(context: Context, hand: Value) -> Row:
    return (), _FREED + _moved(context, hand)


def _drive(_context: Context, hand: Value) -> Row:
    return (), _FREED + _carried(hand)


def _moved(context: Context, hand: Value) -> Effect:
    """Return the writes of a motion of the hand alone about the held item.

    It takes an item off a table and out of a bowl. In a compartment of furniture the item may stay `inside`: detectors
    read that until the hand has backed out.
    """
    item = held_by(hand)
    if item is None:
        return _carried(hand)
    risen = tuple(entry for entry in _carried_item(item) if entry[0][0] != "inside")
    return risen + tuple((("inside", item, vessel), False) for vessel in context.vessels if vessel != item)


def _carried(hand: Value) -> Effect:
    """Return the writes of a motion of the hand about the held item; a fixture's handle is not held."""
    if hand is None:
        return tuple(((predicate, ANY, ANY), None) for predicate in (*RESTING, *VAGUE))
    item = held_by(hand)
    return () if item is None else _carried_item(item)


@cache
def _carried_item(item: str) -> Effect:
    """Return the writes of carrying an item: it rests nowhere, and its neighbours are unknown."""
    nowhere: list[tuple[Fact, Value]] = [((predicate, item, ANY), False) for predicate in RESTING]
    for predicate in VAGUE:
        nowhere.extend((((predicate, item, ANY), None), ((predicate, ANY, item), None)))
    return tuple(nowhere)


def _released(context: Context, hand: Value) -> Effect:
    """Return the writes of a release about the held item."""
    if hand is None:
        return tuple(((predicate, ANY, ANY), None) for predicate in RESTING)
    if context.placement is None or held_by(hand) != context.target:
        # It falls to the floor, or stays where it was if it was never lifted: no resting place is gained.
        return ()
    relation, support = context.placement
    # The converse cannot hold as well (antisymmetry), whatever was known of it.
    return (((relation, context.target, support), True), ((relation, support, context.target), False))


def cargo(primitive: Primitive, context: Context, hand: Value, parameter: Parameter, read: Reader) -> Effect:
    """Return what a primitive writes about cargo, by what is known of who carries whom."""
    if primitive > LAST_BUILT_IN:
        own = own_of(primitive)
        return () if own is None or not own.row.robot else _own_cargo(own, context, read)
    item = held_by(hand)
    if item is None:
        return ()
    load = Load(context.carriage, item, read)
    if primitive is Primitive.UNGRASP:
        if context.placement is None or item != context.target:
            return ()
        return tuple(load.set_down(*context.placement).items())
    if not carries(primitive, parameter) or not load.riding:
        return ()
    leaves_all = primitive in _LEAVING

    def kept(fact: Fact) -> bool:
        return not leaves_all and fact[0] == "inside" and fact[2] not in context.vessels

    return tuple(load.carried_off(kept).items())


# By the number of the primitive; the default is plain motion, and 0 is no primitive.
_TABLE: list[Callable[[Context, Value], Row]] = [_move] * (len(Primitive) + 1)
_TABLE[Primitive.APPROACH] = _approach
_TABLE[Primitive.CONVERGE] = _converge
_TABLE[Primitive.GRASP] = _grasp
_TABLE[Primitive.ARTICULATE_OPEN] = _articulate_open
_TABLE[Primitive.ARTICULATE_CLOSE] = _articulate_close
_TABLE[Primitive.UNGRASP] = _ungrasp
_TABLE[Primitive.RETREAT] = _retreat
for _driving in (
    Primitive.MOVE_BASE_FORWARD,
    Primitive.MOVE_BASE_BACKWARD,
    Primitive.MOVE_BASE_LEFT,
    Primitive.MOVE_BASE_RIGHT,
):
    _TABLE[_driving] = _drive
_TABLE[Primitive.NAVIGATE_TO_TARGET] = _navigate_to_target
_TABLE[Primitive.NAVIGATE_TO_SUPPORT] = _navigate_to_support


_SAMPLE = Carriage(
    (("t", ("x", "y")), ("x", ("y",))),
    (("x", (("inside", "t"), ("ontop", "s"))), ("y", (("inside", "x"), ("ontop", "t"))), ("s", (("inside", "x"),))),
)

_NOTHING_KNOWN: dict[Fact, Value] = {}
_ALL_SO: dict[Fact, Value] = {(place[0], name, place[1]): True for name, found in _SAMPLE.places for place in found}


def library_sha(domain: Domain = BUILT_IN) -> str:
    """Return the SHA-256 of the primitives of a domain; certificates carry it."""
    if domain.built_in:
        return _table_sha()
    return hashlib.sha256(f"{_table_sha()} {domain.digest}".encode()).hexdigest()


@cache
def _table_sha() -> str:
    """Return the SHA-256 of the table's content, tried on sample objects."""
    digest = hashlib.sha256(repr(sorted(_OPEN_AT_TOP)).encode())
    placements = (None, Placement("ontop", "s"), Placement("inside", "s"))
    samples: tuple[Parameter, ...] = (0.0, 0.2, (0.0, 0.0), (0.0, 0.6), (0.5, 1.0), (0.1, 1.5))
    for is_item, placement in product((True, False), placements):
        context = Context("t", "s", placement, is_item, ("s",), ("t", "x", "y"))
        for primitive, hand in product(Primitive, (None, EMPTY, holding("t"), holding("x"), gripping("t"))):
            row = (int(primitive), is_item, placement, hand)
            table = (requirements(primitive, context, hand), effect(primitive, context, hand))
            numbered = tuple(effect(primitive, context, hand, number) for number in samples)
            digest.update(repr((row, table, numbered)).encode())
        loaded = context._replace(support_goal="x", carriage=_SAMPLE)
        for primitive, hand in product(Primitive, (holding("t"), holding("x"))):
            moved = [cargo(primitive, loaded, hand, None, known.get) for known in (_ALL_SO, _NOTHING_KNOWN)]
            digest.update(repr((requirements(primitive, loaded, hand), moved)).encode())
    return digest.hexdigest()


def impossible(objects: Mapping[str, str], articulated: Container[str]) -> Iterator[Fact]:
    """Yield the facts and patterns that no state makes true: `open` without a joint, `inside` what has no inside."""
    for name, category in objects.items():
        if name not in articulated:
            yield "open", name
        if not has_inside(category):
            yield "inside", ANY, name


def converse(fact: Fact) -> Fact | None:
    """Return the fact that excludes this one (itself, for an object on itself); None if there is none."""
    if len(fact) == 3 and fact[0] in RESTING:
        return fact[0], fact[2], fact[1]
    return None


def excluded(fact: Fact, read: Callable[[Fact], Value]) -> bool:
    """Decide whether what is known excludes a fact: nothing is on itself, and no two objects are on each other."""
    other = converse(fact)
    return other is not None and (other == fact or read(other) is True)


def with_consequences(fact: Fact, value: Value) -> Effect:
    """Return what is known once a fact of the start is stated or assumed: the fact, and what it excludes."""
    other = converse(fact)
    return ((fact, value),) if other is None or value is not True else ((fact, value), (other, False))
