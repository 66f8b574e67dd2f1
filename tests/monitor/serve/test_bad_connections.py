"""Data that is not ZeroMQ, or not a request, affects its own connection only."""

import random
import socket

import pytest
import zmq

import btcore
from btcore_monitor.serve import Publisher, serve

GREETING_TIMEOUT_S = b"\xff" + b"\0" * 8 + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\0") + b"\0" * 32
JUNK = {
    "nothing": b"",
    "http": b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n",
    "zeros": b"\0" * 5000,
    "noise": random.Random(7).randbytes(20_000),
    "a greeting and noise": GREETING_TIMEOUT_S + random.Random(8).randbytes(2000),
    "a frame with a huge length": GREETING_TIMEOUT_S + b"\x02" + (1 << 62).to_bytes(8, "big"),
}


def ports(publisher: Publisher) -> list[int]:
    """Return the ports that *publisher* listens at."""
    assert publisher.groot1_port is not None
    return [*range(publisher.port, publisher.port + 3), publisher.groot1_port, publisher.groot1_port + 1]


@pytest.mark.parametrize("name", JUNK)
def test_both_protocols_work_after_junk_at_any_port(
    name: str, endless: btcore.Tree, no_threads_left: None
) -> None:
    with serve(endless, groot2_port=0, groot1_port=0) as publisher, zmq.Context() as context:
        for port in ports(publisher):
            with socket.create_connection(("127.0.0.1", port), timeout=60) as junk:
                junk.sendall(JUNK[name])
        endless.tick_exactly_once()
        for port, question in ((publisher.port, b"\x02S1234"), (publisher.groot1_port + 1, b"")):
            with context.socket(zmq.REQ) as asking:
                asking.setsockopt(zmq.LINGER, 0)
                asking.connect(f"tcp://127.0.0.1:{port}")
                asking.send(question)
                assert asking.poll(60_000), f"no reply at {port}"
                assert len(asking.recv_multipart()[-1]) > 0


def test_a_request_without_the_empty_delimiter_frame_is_dropped(
    endless: btcore.Tree, no_threads_left: None
) -> None:
    """A REP socket drops a request without the empty frame, and the next request is answered."""
    with serve(endless, groot2_port=0, groot1_port=0) as publisher, zmq.Context() as context:
        assert publisher.groot1_port is not None
        for port, question in ((publisher.port, b"\x02S1234"), (publisher.groot1_port + 1, b"any")):
            with context.socket(zmq.DEALER) as dealer:
                dealer.setsockopt(zmq.LINGER, 0)
                dealer.connect(f"tcp://127.0.0.1:{port}")
                dealer.send(b"no delimiter")
                dealer.send_multipart([b"", question])
                assert dealer.poll(60_000), f"no reply at {port}"
                assert dealer.recv_multipart()[0] == b""
                assert not dealer.poll(100)
