"""The client of the run channel, with a robot that sends faster than the client reads."""

from collections.abc import Callable, Iterator

import pytest
import zmq

from btcore_monitor.watch.address import parse_address
from btcore_monitor.watch.run_channel_client import MAX_EARLY_BYTES, RunChannelClient
from btcore_monitor.wire import run_channel as wire

TREE_ID = "a" * 32
MESSAGES = 400
PADDING = "x" * 64_000


class Robot:
    """Messages of 64 kB, and replies to the client's requests for missing messages."""

    def __init__(self) -> None:
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.XPUB)
        self._socket.setsockopt(zmq.LINGER, 0)
        port = self._socket.bind_to_random_port("tcp://127.0.0.1")
        self.address = parse_address(f"127.0.0.1:{port - wire.PORT_OFFSET}")
        self.requested: list[int] = []

    def answer(self) -> None:
        """Reply to the requests that have arrived."""
        while self._socket.poll(20):
            frame = self._socket.recv()
            topic, parts = frame[1:], frame[1:].split(b"/")
            if frame[0] != 1 or parts[0] != b"request":
                continue
            if parts[1] == b"tree":
                tree = wire.TreeMessage(TREE_ID, 0, 0, b"", 1, MESSAGES, {})
                self._socket.send_multipart([topic, wire.encode(tree)])
            else:
                self.requested.append(int(parts[1]))
                self.send(topic, int(parts[1]), 10)

    def send(self, topic: bytes, first: int, count: int = 1) -> None:
        last = min(first + count - 1, MESSAGES)
        messages = [
            wire.encode(wire.ExceptionMessage(TREE_ID, seq, seq, seq, "path", PADDING))
            for seq in range(first, last + 1)
        ]
        piece = wire.PieceMessage(TREE_ID, first, last, MESSAGES, messages)
        self._socket.send_multipart([topic, wire.encode(piece)])

    def close(self) -> None:
        self._context.destroy(linger=0)


@pytest.fixture
def robot() -> Iterator[Robot]:
    robot = Robot()
    yield robot
    robot.close()


def test_early_messages_take_limited_memory_and_are_kept(robot: Robot, until: Callable[..., None]) -> None:
    client = RunChannelClient(robot.address)
    received: list[int] = []

    def read() -> None:
        received.extend(
            message.seq for message in client.read() if isinstance(message, wire.ExceptionMessage)
        )
        assert client._early_bytes <= MAX_EARLY_BYTES
        assert sum(len(data) for piece in client._early_pieces.values() for data in piece.messages) <= (
            MAX_EARLY_BYTES
        )

    def connected() -> bool:
        robot.answer()
        read()
        return client.tree_id == TREE_ID

    try:
        until(connected, "the tree")
        # The client has not received the first messages, and gets 25 MB of later messages.
        for seq in range(10, MESSAGES + 1):
            robot.send(wire.STREAM_TOPIC, seq)
        until(lambda: read() or client._early_bytes > MAX_EARLY_BYTES - len(PADDING) * 2, "the messages")
        assert not received

        def complete() -> bool:
            robot.answer()
            read()
            return len(received) >= MESSAGES

        until(complete, "all messages")
        assert received == list(range(1, MESSAGES + 1))
        assert min(robot.requested) == 1
        assert max(robot.requested) > 10, "dropped messages are requested again"
        assert not client._early_pieces
        assert client._early_bytes == 0
    finally:
        client.close()
