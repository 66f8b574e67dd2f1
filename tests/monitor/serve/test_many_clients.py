"""Many simultaneous clients, some with unusual requests: each gets the replies to its own requests only."""

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import zmq

import btcore
from btcore_monitor.serve import serve
from btcore_monitor.serve.publisher import Publisher
from btcore_monitor.serve.request_socket import MAX_WAITING_FRAMES, RequestSocket


@pytest.fixture
def served(endless: btcore.Tree, no_threads_left: None) -> Iterator[Publisher]:
    with serve(endless, groot2_port=0) as publisher:
        yield publisher


@pytest.fixture
def dealer(served: Publisher) -> Iterator[Callable[..., Any]]:
    """``dealer()``: a client that may send any frames."""
    with contextlib.ExitStack() as stack:
        context = stack.enter_context(zmq.Context())

        def made() -> zmq.Socket:
            socket = stack.enter_context(context.socket(zmq.DEALER))
            socket.linger = 0
            socket.connect(f"tcp://127.0.0.1:{served.port}")
            return socket

        yield made


def request(kind: bytes, number: int) -> bytes:
    return b"\x02" + kind + number.to_bytes(4, "little")


def test_replies_go_to_the_requesting_client(dealer: Callable[..., Any]) -> None:
    clients = [dealer() for _ in range(20)]
    for turn in range(10):
        for at, client in enumerate(clients):
            client.send_multipart([b"", request(b"S", 100 * at + turn)])
    for at, client in enumerate(clients):
        for turn in range(10):
            assert client.poll(60_000)
            empty, header, _ = client.recv_multipart()
            assert (empty, header[:6]) == (b"", request(b"S", 100 * at + turn))
        assert not client.poll(0)


def test_a_reply_has_the_routing_envelope_of_its_request(dealer: Callable[..., Any]) -> None:
    """As with a REP socket, the envelope ends at the first empty frame, and is returned unchanged."""
    client = dealer()
    client.send_multipart([b"first", b"second", b"", request(b"B", 7), b""])
    assert client.poll(60_000)
    first, second, empty, header, boards = client.recv_multipart()
    assert (first, second, empty, header[:6]) == (b"first", b"second", b"", request(b"B", 7))
    assert boards


@pytest.mark.parametrize(
    "frames",
    [[b""], [b"", b""], [b"", b"", b""], [b"", b"\x02S1234", b"", b"more"], [b"", b"\x02B1234"]],
    ids=["nothing", "an empty request", "two empty frames", "an additional frame", "a missing frame"],
)
def test_bad_request_does_not_affect_other_clients(dealer: Callable[..., Any], frames: list[bytes]) -> None:
    odd, client = dealer(), dealer()
    odd.send_multipart(frames)
    client.send_multipart([b"", request(b"S", 1)])
    odd.send_multipart([b"", request(b"S", 2)])
    for socket, number in ((client, 1), (odd, 2)):
        answers = []
        while not answers or answers[-1][1][:6] != request(b"S", number):
            assert socket.poll(60_000)
            answers.append(socket.recv_multipart())
        assert len(answers) <= (2 if socket is odd else 1)


def test_clients_that_leave_before_the_reply_do_no_harm(dealer: Callable[..., Any]) -> None:
    for _ in range(20):
        with dealer() as gone:
            gone.linger = 100
            gone.send_multipart([b"", request(b"T", 1)])
    client = dealer()
    client.send_multipart([b"", request(b"S", 3)])
    assert client.poll(60_000)
    assert client.recv_multipart()[1][:6] == request(b"S", 3)


def test_waiting_replies_to_a_client_that_does_not_read_are_limited() -> None:
    big, requests = b"x" * 1_000_000, 4 * MAX_WAITING_FRAMES
    with zmq.Context() as context, context.socket(zmq.DEALER) as deaf:
        questions = RequestSocket(context, 1000)
        with questions.socket:
            port = questions.socket.bind_to_random_port("tcp://127.0.0.1")
            deaf.linger = 0
            deaf.rcvhwm = 1
            deaf.connect(f"tcp://127.0.0.1:{port}")
            for _ in range(requests):
                deaf.send_multipart([b"", b"any"])
                assert questions.socket.poll(60_000)
                assert questions.receive() == [b"any"]
                questions.answer([big])
            answers = 0
            while deaf.poll(500):
                assert deaf.recv_multipart() == [b"", big]
                answers += 1
    assert 0 < answers < 2 * MAX_WAITING_FRAMES
