"""Plans on which two rules once competed: whichever is applied first, one form comes out."""

from __future__ import annotations

import pytest

import oag
from oag.task.wellformed import check
from tests.bruteforce import Fact, Literal, Part
from tests.oag.orders import TooManyOrders, forms
from tests.properties.plans import FACTS, Case, closing, opening, picking, placing

OPEN: Literal = (("open", "fridge_0"), True)
SHUT: Literal = (("open", "fridge_0"), False)
CABINET_OPEN: Literal = (("open", "cabinet_0"), True)
CABINET_SHUT: Literal = (("open", "cabinet_0"), False)
IN_FRIDGE: Fact = ("inside", "apple_0", "fridge_0")
ON_TABLE: Fact = ("ontop", "apple_0", "table_0")
ON_CUP: Fact = ("ontop", "apple_0", "cup_0")
ON_CABINET: Fact = ("ontop", "apple_0", "cabinet_0")
CUP_IN: Fact = ("inside", "cup_0", "cabinet_0")
IN_CUP: Fact = ("inside", "apple_0", "cup_0")
HELD: Literal = (("inside", "apple_0", "gripper"), True)


def fridge(*flow: int, init: tuple[Literal, ...] = (), goal: tuple[Literal, ...] = ()) -> Part:
    """A subtask about the fridge."""
    return Part("fridge_0", None, init, goal, flow)


def cabinet(*flow: int, init: tuple[Literal, ...] = (), goal: tuple[Literal, ...] = ()) -> Part:
    """A subtask about the cabinet."""
    return Part("cabinet_0", None, init, goal, flow)


def apple(
    *flow: int, init: tuple[Literal, ...] = (), goal: tuple[Literal, ...] = (), support: str | None = None
) -> Part:
    """A subtask about the apple."""
    return Part("apple_0", support, init, goal, flow)


def case(
    *parts: Part, holds: tuple[Fact, ...] = (), unknown: tuple[Fact, ...] = (), closed: tuple[str, ...] = ()
) -> Case:
    """A plan from a start in which these facts alone hold."""
    return Case({fact: fact in holds for fact in FACTS if fact not in unknown}, unknown, parts, (), closed)


COMPETING = {
    # A second half that does again what was done, and the first half that it is to be joined with.
    "join or drop the second half": case(
        opening("fridge_0"), fridge(17, 1, 2, 3, init=(SHUT,)), fridge(4, goal=(OPEN,))
    ),
    "join or drop the middle": case(
        fridge(17, 1, 2, 3, 4, init=(SHUT,)),
        fridge(4),
        fridge(5, goal=(OPEN,)),
        picking("apple_0", ON_CUP),
        closing("fridge_0"),
        holds=(ON_CUP,),
    ),
    # Both are superfluous; without the first, the second continues a movement.
    "drop one or the other": case(
        fridge(17, 1, 2, 17, 3, 4, init=(SHUT,), goal=(OPEN,)),
        fridge(17, 1, 2, 17, 3, init=(SHUT,), goal=(OPEN,)),
        fridge(4, init=(OPEN,), goal=(OPEN,)),
    ),
    "drop a drive or the detour after it": case(
        picking("apple_0", ON_CUP),
        apple(18, init=(HELD,), support="table_0"),
        Part("table_0", None, (), (), (17,)),
        apple(13, 9, 5, init=(HELD,), goal=((ON_TABLE, True),), support="table_0"),
        holds=(ON_CUP,),
    ),
    # One subtask is superfluous, so are its two halves.
    "drop or split, back to where it was": case(
        picking("apple_0", IN_FRIDGE),
        placing("apple_0", "inside", "fridge_0"),
        apple(
            *(17, 1, 2, 3, 7, 18, 13, 9, 5), init=((IN_FRIDGE, True),), goal=((IN_FRIDGE, True),), support="fridge_0"
        ),
        holds=(IN_FRIDGE,),
    ),
    "drop or split, without a place to begin": case(
        apple(17, 1, 2, 3, 7, goal=(HELD,)),
        placing("apple_0", "ontop", "table_0"),
        apple(2, 3, 7, 18, 13, 9, 5, goal=((ON_TABLE, True),), support="table_0"),
        unknown=(ON_CUP,),
    ),
    # A putting down with nothing in the hand did what the transport would do, but no picking up came before it.
    "drop or split, after its second half alone": case(
        placing("apple_0", "inside", "fridge_0"),
        apple(*(17, 1, 2, 3, 7, 18, 13, 9, 5), init=((ON_TABLE, True),), goal=((IN_FRIDGE, True),), support="fridge_0"),
    ),
    # What is known at the second cut depends on whether the first one is joined already.
    "join here or there": case(
        apple(18, 13, 9, init=(HELD,), goal=(HELD,), support="table_0"),
        apple(5, init=(HELD,), goal=((ON_TABLE, True),), support="table_0"),
        apple(17, init=((ON_CUP, True),)),
        apple(1, 2, 3, 7, goal=(HELD,)),
        holds=(ON_CUP,),
    ),
    "join here or there, a thing taken to be in the hand": case(
        apple(18, 13, 9, init=(HELD,), goal=(HELD,), support="table_0"),
        apple(5, goal=((ON_TABLE, True),), support="table_0"),
        apple(17, init=((ON_CUP, True),)),
        apple(1, 2, 3, 7, init=((ON_CUP, False),), goal=(HELD,)),
        holds=(ON_CUP,),
    ),
    # Three pieces of one movement whose conditions contradict each other.
    "join the first two or the last two": case(
        apple(17, init=((ON_CUP, True),)),
        apple(1, 2, 3, goal=((ON_CUP, False),)),
        apple(7, 7, init=((ON_CUP, False),), goal=((ON_CUP, False),)),
        unknown=(ON_CUP,),
    ),
    # With the moves before it, the second needs the apple in the hand.
    "join or name the goal": case(
        apple(18, init=(HELD,), goal=((ON_CUP, False),), support="cabinet_0"),
        apple(13, 9, 5, 17, 1, 2, 3, 7, goal=((ON_CUP, False),), support="cabinet_0"),
    ),
    # Letting go with an empty hand; together with what is said before or after it, it would need the apple there.
    "join before or after letting go of nothing": case(
        apple(17, 7, 18, 13, 9, init=(HELD,), goal=(HELD,), support="fridge_0"),
        apple(5, goal=((IN_FRIDGE, True),), support="fridge_0"),
        apple(7, 18, 13, 9, init=(HELD,), goal=(HELD,), support="fridge_0"),
    ),
    "join what puts down and picks up, or drop the picking up after it": case(
        apple(18, init=(HELD,), goal=(HELD,), support="table_0"),
        apple(13, 9, 5, 17, 1, 2, 3, 7, goal=((ON_CUP, False),), support="table_0"),
        picking("apple_0", ON_CUP),
        holds=(ON_CUP,),
    ),
    # The last one writes nothing: it would repeat whatever was done, be it by a half of a movement.
    "drop the whole of what takes hold and lets go, or a half of it": case(
        fridge(17, 1, 2, 3, 1, init=(OPEN,)),
        fridge(17, 1, 2, 3, 1, init=(OPEN,)),
        fridge(5, goal=(SHUT,)),
        fridge(17, 1, 2, 3, 1, 5, init=(OPEN,), goal=(SHUT,)),
    ),
    # The third is superfluous alone, and together with the putting down after it.
    "drop one of a pair or the pair": case(
        apple(18, 13, 9, 5, init=(HELD,), goal=((ON_TABLE, True),), support="table_0"),
        apple(17, 1, 2, 3, init=((ON_CUP, True),)),
        apple(17, 1, 2, 3, init=((ON_CUP, True),)),
        apple(18, 13, 9, 5, init=(HELD,), goal=((ON_TABLE, True),), support="table_0"),
        apple(17, 1, 2, 3, 7, init=((ON_CUP, True),), goal=((ON_CUP, False),)),
        holds=(ON_CUP,),
    ),
    # Without the second, the drive before it begins the third.
    "drop a drive or what comes between it and its movement": case(
        closing("fridge_0"),
        fridge(17, 1, 2, init=(SHUT,)),
        closing("fridge_0"),
        fridge(3, 4, 5, init=(SHUT,), goal=(OPEN,)),
        holds=(("open", "fridge_0"),),
    ),
    # Both are superfluous; without the drive, the other is the second half of what comes before it.
    "drop a drive or a second half that repeats": case(
        cabinet(17, 1, 13, 2, 3, 4, init=(CABINET_SHUT,), goal=(CABINET_OPEN,)),
        cabinet(17),
        cabinet(17, 1, 13, 2, 3, init=(CABINET_SHUT,)),
        cabinet(4, goal=(CABINET_OPEN,)),
        cabinet(17, init=(CABINET_OPEN,)),
        cabinet(1, 2, 3, 19, 9, init=(CABINET_SHUT,), goal=(CABINET_SHUT,)),
    ),
    "drop one of two that take hold": case(
        fridge(17, 1, 2, 6, 3, 19, init=(OPEN,), goal=(SHUT,)),
        fridge(17, 1, 2, 6, 3, init=(OPEN,), goal=(SHUT,)),
        fridge(17, 19, 19, goal=(SHUT,)),
        fridge(17, 1, 2, 6, 3, 4, init=(SHUT,), goal=(OPEN,)),
        holds=(("open", "fridge_0"),),
    ),
    # The drive between two superfluous subtasks is superfluous as well.
    "drop before a drive or after it": case(
        opening("fridge_0"),
        fridge(17, 1, 2, init=(OPEN,), goal=(OPEN,)),
        fridge(17, init=(SHUT,), goal=(SHUT,)),
        fridge(17, 1, 2, 3, 4, 5, init=(SHUT,), goal=(OPEN,)),
        fridge(1, 2, 3, 4, 5, goal=(OPEN,)),
        fridge(3, 19, 5, goal=(SHUT,)),
        holds=(("open", "fridge_0"),),
    ),
    # Cut in two, what comes before it leaves the hand empty.
    "split, or join after it": case(
        apple(17, 1, 2, 3, 2, 7, init=((IN_CUP, True),), goal=((IN_CUP, False),)),
        apple(*(17, 1, 2, 3, 2, 7, 18, 13, 9, 5), init=((IN_CUP, True),), goal=((ON_TABLE, True),), support="table_0"),
        apple(17, init=((IN_CUP, True),)),
        apple(1, 2, 3, goal=((IN_CUP, False),)),
        apple(2, 7, goal=((IN_CUP, False),)),
        holds=(IN_CUP,),
    ),
    # Whether the apple is taken to have been in the hand hangs on whether the first two are one already.
    "join what puts down, or what lifts what is put down": case(
        apple(18, 13, init=(HELD,), support="fridge_0"),
        apple(9, 5, goal=((IN_FRIDGE, True),), support="fridge_0"),
        apple(1, 2, 3, goal=((ON_CABINET, False),)),
        apple(7, init=((ON_CABINET, False),), goal=((ON_CABINET, False),)),
        closed=("inside",),
    ),
    # The second of three goes on from where the first left the robot.
    "drop a part, or what goes on after it": case(
        *(closing("cabinet_0"), picking("cup_0", CUP_IN), placing("cup_0", "ontop", "table_0"), closing("cabinet_0")),
        cabinet(17, 1, 2, 3, 19, 5, init=(CABINET_SHUT,), goal=(CABINET_SHUT,)),
        cabinet(4, 5, init=(CABINET_SHUT,), goal=(CABINET_OPEN,)),
        holds=(CUP_IN,),
        unknown=(("open", "cabinet_0"),),
    ),
    "drop a drive or repetitions after it": case(
        *(opening("fridge_0"), picking("apple_0", ON_CUP), placing("apple_0", "inside", "fridge_0")),
        fridge(17, 1, 2, init=(OPEN,)),
        *(opening("fridge_0"), opening("fridge_0")),
        fridge(3, 19, 5, goal=(SHUT,)),
        unknown=(ON_CUP,),
    ),
}


@pytest.mark.parametrize("name", COMPETING)
def test_every_order_of_changes_gives_one_form(name: str) -> None:
    task = COMPETING[name].task()
    assert not check(task, COMPETING[name].scene())
    assert len(forms(task)) == 1


def test_a_superfluous_transport_goes_however_it_is_written() -> None:
    """In one subtask or in two, with the door open, fetching a thing from where it belongs and putting it back."""
    start = (opening("fridge_0"), picking("apple_0", ON_TABLE), placing("apple_0", "inside", "fridge_0"))
    back = (picking("apple_0", IN_FRIDGE), placing("apple_0", "inside", "fridge_0"))
    whole = apple(*back[0].flow, *back[1].flow, init=back[0].init, goal=back[1].goal, support="fridge_0")
    plain, halves, one = (oag.canonical(case(*start, *more, holds=(ON_TABLE,)).task()) for more in ((), back, (whole,)))
    assert plain.subtasks == halves.subtasks == one.subtasks


def test_a_plan_with_too_many_orders_is_refused() -> None:
    with pytest.raises(TooManyOrders):
        forms(COMPETING["join or drop the middle"].task(), most=2)
