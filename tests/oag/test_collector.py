"""Holding the garbage collector back leaves it as it was, whatever happens inside."""

from __future__ import annotations

import gc

import pytest

from oag.collector import held_back


def test_it_is_off_inside_and_on_again_behind() -> None:
    with held_back():
        assert not gc.isenabled()
    assert gc.isenabled()


def test_it_is_on_again_behind_an_exception() -> None:
    with pytest.raises(KeyError), held_back():
        raise KeyError
    assert gc.isenabled()


def test_whoever_had_it_off_keeps_it_off() -> None:
    gc.disable()
    try:
        with held_back():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()
