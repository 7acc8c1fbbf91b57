"""The stages run with one thread of BLAS, and leave those of the caller as they are."""

import inspect

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import wallid
from wallid._internal.blas_threads import one_blas_thread


def threads():
    """Of each BLAS library that is loaded."""
    return [one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"]


@one_blas_thread
def in_a_stage():
    return threads()


def test_a_stage_has_one_thread_and_the_caller_its_own():
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        assert max(before) > 1 and set(in_a_stage()) == {1}
        assert threads() == before


def test_threads_come_back_after_a_stage_within_a_stage():
    @one_blas_thread
    def outer():
        return in_a_stage()

    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        assert set(outer()) == {1}
        assert threads() == before


def test_threads_come_back_after_an_error():
    @one_blas_thread
    def failing():
        raise ValueError

    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        with pytest.raises(ValueError):
            failing()
        assert threads() == before


@pytest.mark.parametrize("name", ["estimate", "campaign", "forecast", "diagnose", "plan", "design", "place_sensors"])
def test_stages_keep_their_signature_and_docstring(name):
    stage = getattr(wallid, name)
    assert "args" not in inspect.signature(stage).parameters and stage.__doc__
