"""The gateway between clients and the publisher: what it lets through, and its limits."""

import contextlib
import os
import random
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zmq

import btcore
from btcore_monitor.serve import gateway, gateway_process, serve
from btcore_monitor.serve.gateway import Gateway
from btcore_monitor.serve.gateway_process import ClientStream
from btcore_monitor.wire.run_channel import REQUEST_TOPIC

SIGNATURE = b"\xff" + b"\0" * 8 + b"\x7f"
NULL = b"NULL".ljust(20, b"\0")
READY = b"\x04\x19\x05READY\x0bSocket-Type\0\0\0\x03SUB"


def greeting(minor: int, mechanism: bytes = b"NULL") -> bytes:
    return SIGNATURE + bytes([3, minor]) + mechanism.ljust(20, b"\0") + bytes(32)


def frame(body: bytes, flags: int = 0) -> bytes:
    if len(body) < 256:
        return bytes([flags, len(body)]) + body
    return bytes([flags | 2]) + len(body).to_bytes(8, "big") + body


def command(name: bytes, body: bytes = b"") -> bytes:
    return frame(bytes([len(name)]) + name + body, 4)


def verdict(data: bytes, takes_topics: bool, sizes: random.Random | None = None) -> str:
    """The reason why a client that sends *data* is disconnected, or "" if it is not."""
    stream = ClientStream(takes_topics, 1000)
    try:
        while data:
            piece = data[: sizes.randint(1, 40)] if sizes else data
            checked = stream.check(piece, sizes.randint(1, 3) if sizes else 10_000)
            data = data[checked:]
    except ConnectionAbortedError as error:
        return str(error)
    return ""


V30, V31 = greeting(0) + READY, greeting(1) + READY
V20_SUB, V20_REQ = SIGNATURE + b"\1\2" + frame(b""), SIGNATURE + b"\1\3" + frame(b"me")
CURVE = greeting(1, b"CURVE") + command(b"HELLO", bytes(190)) + command(b"INITIATE", bytes(300))
MANY = [b"%03d" % number for number in range(33)]
TOPICS = {
    "3.0": (V30 + frame(b"\1stream") + frame(b"\0stream"), ""),
    "3.1": (V31 + command(b"SUBSCRIBE", b"stream") + command(b"CANCEL", b"stream") + command(b"PING"), ""),
    "2.0": (V20_SUB + frame(b"\1stream"), ""),
    "2.0 with an identity": (SIGNATURE + b"\1\2" + frame(b"me") + frame(b"\1"), ""),
    "encrypted": (CURVE + frame(b"\x07MESSAGE" + bytes(60)), ""),
    "a topic of 200 bytes": (V30 + frame(b"\1" + bytes(200)), ""),
    "many topics, one after the other": (
        V31 + b"".join(command(b"SUBSCRIBE", topic) + command(b"CANCEL", topic) for topic in MANY),
        "",
    ),
    "32 topics, twice": (V30 + b"".join(frame(b"\1" + topic) for topic in MANY[:32] * 2), ""),
    "1.0": (frame(b""), "not ZMTP 2 or 3"),
    "no signature": (b"\xff" + bytes(20), "not ZMTP 2 or 3"),
    "revision 0": (SIGNATURE + b"\0\1", "not ZMTP 2 or 3"),
    "flags": (V30 + b"\x08\1\1", "not a frame of ZMTP"),
    "a command with more frames": (V31 + b"\x05\1\1", "not a frame of ZMTP"),
    "a topic of 201 bytes": (V30 + frame(b"\1" + bytes(201)), "too many bytes"),
    "a topic of 201 bytes by command": (V31 + command(b"SUBSCRIBE", bytes(201)), "too many subscriptions"),
    "33 topics": (V30 + b"".join(frame(b"\1" + topic) for topic in MANY), "too many subscriptions"),
    "33 topics by command": (
        V31 + b"".join(command(b"SUBSCRIBE", topic) for topic in MANY),
        "too many subscriptions",
    ),
    "cancels of other topics": (
        V30 + b"".join(frame(b"\1" + topic) + frame(b"\0x" + topic) for topic in MANY),
        "too many subscriptions",
    ),
    "a message": (V30 + frame(b"hello"), "not a subscription"),
    "an empty message": (V30 + frame(b""), "not a subscription"),
    "two frames": (V30 + frame(b"\1", 1), "not a subscription"),
    "a large command": (V31 + command(b"PING", bytes(2000)), "too many bytes"),
    "an unknown command": (V31 + command(b"JOIN", b"group"), "unknown command"),
    "too much encrypted": (CURVE + 500 * frame(b"\x07MESSAGE" + bytes(60)), "too many subscriptions"),
    "a large encrypted frame": (CURVE + frame(bytes(2000)), "too many bytes"),
}
REQUESTS = {
    "3.0": (V30 + 3 * (frame(b"", 1) + frame(b"\x02S1234")), ""),
    "3.1": (V31 + frame(b"", 1) + frame(b"\x02I1234", 1) + frame(b"{}") + command(b"PONG"), ""),
    "2.0": (V20_REQ + frame(b"", 1) + frame(b""), ""),
    "encrypted": (CURVE + 40 * frame(b"\x07MESSAGE" + bytes(900)), ""),
    "16 frames": (V30 + 2 * (15 * frame(b"", 1) + frame(b"")), ""),
    "1,000 bytes": (V30 + 2 * (frame(bytes(500), 1) + frame(bytes(500))), ""),
    "17 frames": (V30 + 16 * frame(b"", 1) + frame(b""), "too many frames"),
    "17 frames and commands": (V31 + 17 * (frame(b"", 1) + command(b"PING")), "too many frames"),
    "1,001 bytes": (V30 + frame(bytes(500), 1) + frame(bytes(501)), "too many bytes"),
    "a subscription": (V31 + command(b"SUBSCRIBE", b"x"), "unknown command"),
    "a large encrypted frame": (CURVE + frame(bytes(1001)), "too many bytes"),
    "a huge length": (V30 + b"\2" + b"\xff" * 8, "too many bytes"),
}


@pytest.mark.parametrize(
    ("takes_topics", "data", "reason"),
    [
        *(pytest.param(True, *case, id=f"topics: {name}") for name, case in TOPICS.items()),
        *(pytest.param(False, *case, id=f"requests: {name}") for name, case in REQUESTS.items()),
    ],
)
def test_bytes_are_checked_the_same_in_one_piece_and_in_many(
    takes_topics: bool, data: bytes, reason: str
) -> None:
    assert verdict(data, takes_topics) == reason
    for seed in range(20):
        assert verdict(data, takes_topics, random.Random(seed)) == reason


def test_no_byte_after_the_permitted_frames_is_checked() -> None:
    stream = ClientStream(False, 1000)
    data = V30 + 5 * frame(b"")
    assert stream.check(data, 3) == len(V30) + 4
    assert stream.frames == 3  # READY too


def receive(connection: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        piece = connection.recv(size - len(data))
        assert piece, "disconnected"
        data += piece
    return data


def test_a_client_of_zmtp_2_gets_a_reply(endless: btcore.Tree, no_threads_left: None) -> None:
    """As libzmq 3.2 sends: the signature, and the rest only after the server's signature."""
    with serve(endless, groot2_port=0) as publisher:
        address = ("127.0.0.1", publisher.port)
        with socket.create_connection(address, timeout=60) as client:
            client.sendall(SIGNATURE)
            assert receive(client, 10)[0] == 0xFF
            client.sendall(b"\1\3" + frame(b""))  # ZMTP 2.0, REQ, no identity
            receive(client, 2 + 2)  # the server's revision, socket type and empty identity
            client.sendall(frame(b"", 1) + frame(b"\x02S1234"))
            assert receive(client, 4)[:2] == b"\1\0"


def test_client_of_zmtp_3_0_receives_its_subscriptions(endless: btcore.Tree, no_threads_left: None) -> None:
    with serve(endless, groot2_port=0) as publisher:
        client = socket.create_connection(("127.0.0.1", publisher.port + 2), timeout=60)
        with client:
            client.sendall(V30)
            receive(client, 64)
            client.sendall(frame(b"\1heartbeat"))
            data = b""
            while frame(b"heartbeat", 1) not in data:
                data += client.recv(1000)


def test_requests_and_subscriptions_of_the_maximum_size_are_forwarded(
    endless: btcore.Tree, no_threads_left: None, until: Callable[..., None]
) -> None:
    with (
        serve(endless, groot2_port=0, allow_control=True) as publisher,
        zmq.Context() as context,
        context.socket(zmq.REQ) as client,
        socket.create_connection(("127.0.0.1", publisher.port + 1), timeout=60) as topics,
    ):
        client.linger = 0
        client.connect(publisher.address)
        topics.sendall(greeting(0) + READY)
        receive(topics, 64 + 27)  # with READY of the server
        topics.sendall(b"".join(frame(b"\1%03d" % number + bytes(197)) for number in range(31)))
        topics.sendall(frame(b"\1"))
        hook = b'{"enabled":true,"uid":2,"mode":1,"once":false,"desired_status":"SUCCESS","position":0}'
        client.send_multipart([b"\x02I1234", hook.ljust((1 << 20) - 6)])
        assert client.poll(60_000)
        assert client.recv_multipart()[0][:2] == b"\x02I"
        until(
            lambda: endless.tick_exactly_once() and select.select([topics], [], [], 0)[0],
            "a notification: the subscriptions have arrived",
        )
        assert receive(topics, 4) == b"\1\6\x02N"


@pytest.fixture
def stream() -> Iterator[Callable[..., Any]]:
    """``stream(**options)``: a robot's XPUB socket, and port and close() of the gateway in front of it."""
    with contextlib.ExitStack() as stack:

        def made(**options: int) -> tuple[zmq.Socket[bytes], int, Callable[[], None]]:
            context = stack.enter_context(zmq.Context())
            robot = context.socket(zmq.XPUB)
            for name, value in options.items():
                setattr(robot, name, value)
            robot.linger = 0
            robot.maxmsgsize = 1024
            robot.rcvtimeo = robot.sndtimeo = 20_000
            listener = socket.create_server(("127.0.0.1", 0))
            port = listener.getsockname()[1]
            between = Gateway()
            between.add_port(listener, robot)
            between.start()
            stack.callback(between.close)
            stack.callback(robot.close)  # first, as a publisher does
            return robot, port, between.close

        yield made


@contextlib.contextmanager
def subscriber(port: int, *topics: bytes):
    """A connection with ZMTP 3.0 that has subscribed to *topics*."""
    with socket.create_connection(("127.0.0.1", port), timeout=60) as client:
        client.sendall(V30)
        receive(client, 64 + 28)  # with READY of an XPUB socket
        client.sendall(b"".join(frame(b"\1" + topic) for topic in topics))
        yield client


def test_unread_bytes_wait_in_the_gateway_until_there_are_too_many(stream: Callable[..., Any]) -> None:
    # The robot's socket holds 2 messages per client at most, and then it waits.
    robot, port, _ = stream(sndhwm=2, xpub_nodrop=1)
    picture = frame(bytes(1 << 20))
    with subscriber(port, b"") as slow:
        assert robot.recv() == b"\1"
        for _ in range(20):
            robot.send(picture[9:])
        # The client has lost nothing, although it has not read for some time.
        for _ in range(20):
            assert receive(slow, len(picture)) == picture
        with subscriber(port, b"\0") as other:
            assert robot.recv() == b"\1\0"
            for _ in range(gateway_process.MAX_HELD_BYTES // len(picture) + 20):
                robot.send(picture[9:])
                # The client reads slowly.
                with contextlib.suppress(ConnectionError):
                    slow.recv(100)
                assert receive(other, len(picture)) == picture
            assert robot.recv() == b"\0"  # the slow client is disconnected


@pytest.mark.usefixtures("in_a_thread")
def test_connection_has_one_request_at_time_and_port_has_few(
    stream: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gateway_process, "CLIENT_TIMEOUT_S", 60.0)
    monkeypatch.setattr(gateway_process, "PIECE_TIMEOUT_S", 60.0)
    robot, port, _ = stream()
    with contextlib.ExitStack() as clients:
        names = [b"%d" % number for number in range(gateway_process.MAX_PIECES_AT_ONCE)]
        for name in names:
            clients.enter_context(subscriber(port, b"request/1/" + name, b"request/2/" + name))
            assert robot.recv() == b"\1request/1/" + name
        fifth = clients.enter_context(subscriber(port, b"request/1/fifth"))
        with subscriber(port, b"other"):
            assert robot.recv() == b"\1other"
        assert robot.recv() == b"\0other"
        robot.send_multipart([b"request/1/0", bytes(1 << 20)])
        assert robot.recv() == b"\1request/1/fifth"
        robot.send_multipart([b"request/1/fifth", b"piece"])
        assert robot.recv() == b"\1request/2/0"
        receive(fifth, 2 + 13 + 2 + 5)


@pytest.mark.usefixtures("in_a_thread")
def test_request_without_reply_delays_next_request_briefly(
    stream: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert gateway_process._REQUEST_TOPIC == REQUEST_TOPIC + b"/"
    monkeypatch.setattr(gateway_process, "CLIENT_TIMEOUT_S", 60.0)
    monkeypatch.setattr(gateway_process, "PIECE_TIMEOUT_S", 0.0)
    monkeypatch.setattr(gateway_process, "_SWEEP_INTERVAL_S", 0.05)
    robot, port, _ = stream()
    with subscriber(port, b"request/invalid", b"request/1/token", b"stream"):
        assert [robot.recv() for _ in range(3)] == [b"\1request/invalid", b"\1request/1/token", b"\1stream"]


def test_encrypted_clients_are_forwarded_and_limited() -> None:
    server_key, server_secret = zmq.curve_keypair()
    key, secret = zmq.curve_keypair()
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    between = Gateway()
    with zmq.Context() as context, context.socket(zmq.XPUB) as robot, context.socket(zmq.SUB) as client:
        robot.maxmsgsize = 1024
        robot.curve_server = True
        robot.curve_secretkey = server_secret
        client.linger = robot.linger = 0
        client.curve_serverkey, client.curve_publickey, client.curve_secretkey = server_key, key, secret
        between.add_port(listener, robot)
        between.start()
        try:
            client.subscribe(b"topic")
            client.connect(f"tcp://127.0.0.1:{port}")
            assert robot.poll(60_000)
            assert robot.recv() == b"\1topic"
            robot.send(b"topic 1")
            assert client.poll(60_000)
            assert client.recv() == b"topic 1"
            # The client exceeds the bytes of an encrypted subscriber, and comes back with its topics.
            for number in range(400):
                client.subscribe(b"%0150d" % number)
                client.unsubscribe(b"%0150d" % number)
            ends: list[bytes] = []
            deadline = time.monotonic() + 100
            while ends != [b"\0topic", b"\1topic"]:
                robot.send(b"topic 2")
                client.poll(0)  # after the new connection, libzmq subscribes again in this call
                if robot.poll(100):
                    ends += [message for message in (robot.recv(),) if message[1:] == b"topic"]
                assert time.monotonic() < deadline
        finally:
            robot.close()
            between.close()


def test_connection_over_the_limit_waits_until_one_ends(endless: btcore.Tree, no_threads_left: None) -> None:
    with serve(endless, groot2_port=0) as publisher:
        address = ("127.0.0.1", publisher.port)
        held = []
        try:
            for _ in range(gateway_process.MAX_CONNECTIONS):
                held.append(socket.create_connection(address, timeout=60))
                held[-1].sendall(greeting(1))
                receive(held[-1], 64)
            # Another port has connections of its own.
            with socket.create_connection(("127.0.0.1", publisher.port + 1), timeout=60) as other:
                other.sendall(greeting(1))
                receive(other, 64)
            with socket.create_connection(address, timeout=60) as further:
                further.sendall(greeting(1))
                further.settimeout(0.2)
                with pytest.raises(TimeoutError):
                    further.recv(1)
                held.pop().close()
                further.settimeout(60)
                receive(further, 64)
        finally:
            for connection in held:
                connection.close()


@pytest.fixture
def in_a_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """The gateway in a thread, as in a frozen program, with short times."""
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    monkeypatch.setattr(gateway_process, "CLIENT_TIMEOUT_S", 0.5)
    monkeypatch.setattr(gateway_process, "GREETING_TIMEOUT_S", 0.5)


@pytest.mark.usefixtures("in_a_thread")
def test_a_client_that_sends_nothing_is_disconnected(endless: btcore.Tree, no_threads_left: None) -> None:
    with serve(endless, groot2_port=0) as publisher:
        silent = socket.create_connection(("127.0.0.1", publisher.port), timeout=60)
        with silent:
            assert silent.recv(1) == b""


@pytest.mark.usefixtures("in_a_thread")
def test_non_reading_client_is_disconnected_without_harm(endless: btcore.Tree, no_threads_left: None) -> None:
    requests = 100 * (frame(b"", 1) + frame(b"\x02T1234"))
    with (
        serve(endless, groot2_port=0) as publisher,
        zmq.Context() as context,
        socket.socket() as deaf,
        context.socket(zmq.REQ) as client,
    ):
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.settimeout(60)
        deaf.connect(("127.0.0.1", publisher.port))
        deaf.sendall(greeting(1) + command(b"READY", b"\x0bSocket-Type\0\0\0\x03REQ"))
        # The replies fill the buffers. Then nothing of the client is read.
        sent = 0
        with contextlib.suppress(ConnectionError):
            while True:
                sent += deaf.send(requests)
        client.linger = 0
        client.connect(publisher.address)
        client.send(b"\x02S1234")
        assert client.poll(60_000)
    assert sent > len(requests)


def test_a_thread_continues_if_the_process_of_the_gateway_is_killed(
    endless: btcore.Tree, no_threads_left: None, caplog: pytest.LogCaptureFixture
) -> None:
    with (
        serve(endless, groot2_port=0) as publisher,
        zmq.Context() as context,
        context.socket(zmq.REQ) as client,
    ):
        process = publisher._sockets.gateway._process
        process.kill()
        process.wait()
        client.linger = 0
        client.connect(publisher.address)
        client.send(b"\x02S1234")
        assert client.poll(60_000)
    assert "ended with code -9; a thread continues" in caplog.text


def test_without_unix_sockets_a_thread_forwards_by_tcp(
    endless: btcore.Tree, no_threads_left: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gateway, "_HAS_UNIX_SOCKETS", False)
    with (
        serve(endless, groot2_port=0) as publisher,
        zmq.Context() as context,
        context.socket(zmq.REQ) as client,
    ):
        client.linger = 0
        client.connect(publisher.address)
        client.send(b"\x02S1234")
        assert client.poll(60_000)
        assert publisher._sockets.gateway._process is None


def is_listening(port: int) -> bool:
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.1", port)) == 0


ROBOT = """
import sys
import time
import btcore
from btcore_monitor.serve import serve
tree = btcore.loads('<root BTCPP_format="4"><BehaviorTree ID="T"><AlwaysSuccess/></BehaviorTree></root>')
publisher = serve(tree, groot2_port=0)
print(publisher.port, publisher._sockets.gateway._folder, flush=True)
sys.stdin.read()
"""


def test_a_killed_robot_leaves_neither_process_nor_files_nor_ports(until: Callable[..., None]) -> None:
    robot = subprocess.Popen(
        [sys.executable, "-c", ROBOT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with robot:
        assert robot.stdout is not None
        port, folder = robot.stdout.readline().split()
        robot.send_signal(signal.SIGKILL)
        robot.wait()
    until(lambda: not Path(folder).exists(), "the folder is removed")
    # The process removes the folder last.
    until(lambda: not is_listening(int(port)), "the port is closed")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no Unix sockets")
def test_the_next_run_removes_the_folder_of_a_killed_robot_and_gateway(
    endless: btcore.Tree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    with subprocess.Popen(
        [sys.executable, "-c", ROBOT.replace("gateway._folder", "gateway._process.pid")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as robot:
        assert robot.stdout is not None
        _, gateway_pid = robot.stdout.readline().split()
        (killed,) = tmp_path.iterdir()
        with serve(endless, groot2_port=0):
            assert killed.exists(), "the folder of a robot that is running"
        os.kill(int(gateway_pid), signal.SIGSTOP)
        robot.kill()
        os.kill(int(gateway_pid), signal.SIGKILL)
        robot.wait()
    assert list(killed.iterdir())
    with serve(endless, groot2_port=0):
        assert not killed.exists()
    assert not list(tmp_path.iterdir())


def test_closed_publisher_sends_last_messages_first(endless: btcore.Tree, no_threads_left: None) -> None:
    with zmq.Context() as context, context.socket(zmq.SUB) as client:
        publisher = serve(endless, groot2_port=0)
        client.linger = 0
        client.subscribe(b"stream")
        client.subscribe(b"presence/me")
        client.connect(f"tcp://127.0.0.1:{publisher.port + 2}")
        assert publisher.wait_for_clients(1, 60)
        endless.tick_exactly_once()
        publisher.close(grace=0)
        data = b""
        while b"kind\xa3end" not in data:
            assert client.poll(60_000)
            data = client.recv_multipart()[1]


def test_bytes_for_a_client_that_pauses_are_forwarded_at_the_end(stream: Callable[..., Any]) -> None:
    robot, port, close = stream(sndhwm=2, xpub_nodrop=1)
    picture = frame(bytes(1 << 20))
    with subscriber(port, b"") as client:
        assert robot.recv() == b"\1"
        for _ in range(20):
            robot.send(picture[9:])
        robot.close(linger=60_000)
        closing = threading.Thread(target=close)
        closing.start()
        closing.join(0.6)
        for _ in range(20):
            assert receive(client, len(picture)) == picture
        closing.join()
