"""Messages arrive as they were sent, whatever pictures are in them, and a picture that is cut off is no picture."""

from __future__ import annotations

import gc
import pickle
import weakref
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from executive.s3e.backends.wire import receive, send


@pytest.fixture
def ends() -> Iterator[tuple[Connection, Connection]]:
    one, other = Pipe()
    with one, other:
        yield one, other


@settings(max_examples=50, deadline=None)
@given(st.lists(arrays(np.uint8, array_shapes(min_dims=1, max_dims=4, min_side=0)) | st.text() | st.integers()))
def test_what_is_sent_arrives(message: list[Any]) -> None:
    one, other = Pipe()
    with one, other:
        send(one, message)
        received = receive(other)
    assert len(received) == len(message)
    for sent, came in zip(message, received, strict=True):
        assert type(came) is type(sent)
        assert np.array_equal(came, sent)


def test_pictures_larger_than_any_buffer_arrive_in_order(ends: tuple[Connection, Connection]) -> None:
    whole = np.arange(6_000_000, dtype=np.uint8).reshape(1000, 2000, 3)
    first, last = (whole, whole[::2], whole[:, ::-1]), (np.asfortranarray(whole),)
    with ThreadPoolExecutor(1) as sender:
        sending = [sender.submit(send, ends[0], message) for message in (first, "between", last)]
        one, word, other = [receive(ends[1]) for _ in sending]
    assert word == "between"
    for sent, came in zip((*first, *last), (*one, *other), strict=True):
        assert np.array_equal(sent, came)


def test_nothing_is_kept_of_what_was_sent_or_received(ends: tuple[Connection, Connection]) -> None:
    picture = np.zeros((4, 4, 3), np.uint8)
    sent = weakref.ref(picture)
    send(ends[0], picture)
    received = weakref.ref(came := receive(ends[1]))
    del picture, came
    gc.collect()
    assert (sent(), received()) == (None, None)


def test_what_cannot_be_sent_leaves_nothing_behind(ends: tuple[Connection, Connection]) -> None:
    with pytest.raises((TypeError, AttributeError, pickle.PicklingError)):
        send(ends[0], (np.zeros(9, np.uint8), lambda: None))
    send(ends[0], "next")
    assert receive(ends[1]) == "next"


def test_a_picture_that_is_cut_off_is_the_end(ends: tuple[Connection, Connection]) -> None:
    one, other = ends
    apart: list[pickle.PickleBuffer] = []
    head = pickle.dumps(np.zeros(9, np.uint8), protocol=5, buffer_callback=apart.append)
    one.send((head, [9]))
    one.close()
    with pytest.raises(EOFError):
        receive(other)
