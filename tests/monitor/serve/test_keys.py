"""Connections with keys: known clients watch and control, all others are refused, and nothing is readable."""

import logging
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
import zmq
from zmq.utils.monitor import parse_monitor_message

import btcore
from btcore_monitor.breakpoints import BreakpointClient, BreakpointError
from btcore_monitor.events import ConnectionEvent, TransitionEvent, TreeEvent
from btcore_monitor.keys import ClientKeys, RobotKeys, create_keys
from btcore_monitor.serve import ServeError, serve
from btcore_monitor.watch.feed import Feed
from btcore_monitor.watch.handshakes import ConnectionRefusedByRobotError

pytestmark = pytest.mark.usefixtures("no_threads_left")

HANDSHAKES = (
    zmq.EVENT_HANDSHAKE_SUCCEEDED
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the key pairs of the robot, of a known client, and of an unknown client."""
    for name in ("robot", "desk", "unknown_client"):
        create_keys(tmp_path / name)
    return tmp_path


@pytest.fixture
def robot_keys(folder: Path) -> RobotKeys:
    return RobotKeys(folder / "robot", [folder / "desk.pub"])


@pytest.fixture
def desk(folder: Path) -> ClientKeys:
    return ClientKeys(folder / "desk", folder / "robot.pub")


def wrong_keys(folder: Path, kind: str) -> ClientKeys | None:
    return {
        "none": lambda: None,
        "unknown": lambda: ClientKeys(folder / "unknown_client", folder / "robot.pub"),
        "another robot's": lambda: ClientKeys(folder / "desk", folder / "unknown_client.pub"),
    }[kind]()


REFUSALS = {
    "none": "refused the connection: the robot requires keys: use --key-file and --robot-key",
    "unknown": "the robot does not know this key; the public key for --allow-key is [0-9a-f]{64}$",
    "another robot's": "refused the connection: --robot-key is not the public key of this robot",
}


def watch(tree: btcore.Tree, address: str, keys: ClientKeys | None) -> tuple[str, str, int]:
    """Return how a feed is connected, the name of the tree, and the number of transitions of two ticks."""
    seen: list[TransitionEvent] = []
    how = name = ""
    with Feed(address, keys=keys) as feed:
        for event in feed:
            if isinstance(event, ConnectionEvent) and event.state == "connected":
                how = event.detail
            elif isinstance(event, TreeEvent):
                name = event.tree.name
                for _ in range(2):
                    tree.tick_exactly_once()
            elif isinstance(event, TransitionEvent):
                seen.append(event)
            if len(seen) >= 10:
                return how, name, len(seen)
    raise AssertionError


def test_a_known_client_watches_and_controls(
    endless: btcore.Tree, robot_keys: RobotKeys, desk: ClientKeys
) -> None:
    with serve(endless, groot2_port=0, keys=robot_keys, allow_control=True) as publisher:
        how, name, _ = watch(endless, publisher.address, desk)
        assert (how, name) == (f"{publisher.address}, by btcore's run channel", "Endless")
        with BreakpointClient(publisher.address, keys=desk) as robot:
            assert robot.break_at("step") == ["step"]
            tick = threading.Thread(target=endless.tick_exactly_once)
            tick.start()
            assert robot.wait().path == "step"
            robot.release("step", remove=True)
            tick.join(60)


@pytest.mark.parametrize("ports", [{"groot2_port": 0}, {"groot2_port": None, "groot1_port": 0}])
def test_a_known_client_watches_by_the_protocols_of_groot(
    endless: btcore.Tree,
    robot_keys: RobotKeys,
    desk: ClientKeys,
    ports: dict[str, int | None] | dict[str, int],
) -> None:
    with serve(endless, **ports, run_channel=False, keys=robot_keys) as publisher:
        how, name, _ = watch(endless, publisher.address, desk)
    assert f"by Groot {1 if 'groot1_port' in ports else 2}'s protocol" in how
    assert name == ("Endless" if "groot1_port" not in ports else "KeepRunningUntilFailure")


@pytest.mark.parametrize("kind", REFUSALS)
def test_wrong_key_is_reported_to_client(
    endless: btcore.Tree, folder: Path, robot_keys: RobotKeys, kind: str
) -> None:
    with serve(endless, groot2_port=0, keys=robot_keys, allow_control=True) as publisher:
        keys = wrong_keys(folder, kind)
        with pytest.raises(BreakpointError, match=REFUSALS[kind]):
            BreakpointClient(publisher.address, timeout=100, keys=keys)
        with (
            Feed(publisher.address, keys=keys) as feed,
            pytest.raises(ConnectionRefusedByRobotError, match=REFUSALS[kind]),
        ):
            list(feed)
        assert publisher.client_count == 0


def test_a_client_with_keys_gets_an_error_from_a_robot_without_keys(
    endless: btcore.Tree, desk: ClientKeys
) -> None:
    with (
        serve(endless, groot2_port=0, allow_control=True) as publisher,
        pytest.raises(
            BreakpointError, match="this port of the robot does not use keys: omit --key-file and --robot-key"
        ),
    ):
        BreakpointClient(publisher.address, timeout=100, keys=desk)


def test_a_tunnel_to_a_robot_that_is_not_running_is_no_refusal(desk: ClientKeys) -> None:
    """The client continues to wait, although the tunnel closes each connection, as a robot does."""
    closed = 0

    def close_connections() -> None:
        nonlocal closed
        with suppress(OSError):
            while True:
                tunnel.accept()[0].close()
                closed += 1

    with socket.create_server(("127.0.0.1", 0)) as tunnel:
        threading.Thread(target=close_connections, daemon=True).start()
        with Feed(f":{tunnel.getsockname()[1]}", keys=desk) as feed:
            while closed < 12:
                for event in feed.poll(0.05):
                    assert isinstance(event, ConnectionEvent)
                    assert event.state == "waiting"
        tunnel.shutdown(socket.SHUT_RDWR)


@contextmanager
def connected(address: str, kind: int, keys: ClientKeys | None) -> Iterator[tuple[zmq.Socket, int]]:
    """Yield a new socket of *kind* at *address*, and the first event of its handshake."""
    with zmq.Context() as context, context.socket(kind) as client:
        client.linger = 0
        if keys is not None:
            keys.secure(client)
        if kind == zmq.SUB:
            client.subscribe(b"")
        events = client.get_monitor_socket(HANDSHAKES)
        client.connect(address)
        assert events.poll(60_000)
        event = parse_monitor_message(events.recv_multipart())["event"]
        client.disable_monitor()
        events.close(linger=0)
        yield client, event


@pytest.mark.parametrize("kind", REFUSALS)
def test_every_port_refuses_a_wrong_key(
    endless: btcore.Tree, folder: Path, robot_keys: RobotKeys, desk: ClientKeys, kind: str
) -> None:
    keys = wrong_keys(folder, kind)
    with serve(endless, groot2_port=0, groot1_port=0, keys=robot_keys) as publisher:
        assert publisher.groot1_port is not None
        ports = {
            publisher.port: zmq.REQ,
            publisher.port + 1: zmq.SUB,
            publisher.port + 2: zmq.SUB,
            publisher.groot1_port: zmq.SUB,
            publisher.groot1_port + 1: zmq.REQ,
        }
        for port, socket_type in ports.items():
            address = f"tcp://127.0.0.1:{port}"
            with connected(address, socket_type, desk) as (_, event):
                assert event == zmq.EVENT_HANDSHAKE_SUCCEEDED
            with connected(address, socket_type, keys) as (client, event):
                assert event != zmq.EVENT_HANDSHAKE_SUCCEEDED
                if socket_type == zmq.REQ:
                    with suppress(zmq.Again):  # the connection is gone already
                        client.send(b"", zmq.DONTWAIT)
                endless.tick_exactly_once()
                assert not client.poll(50)


class Relay:
    """Forwards TCP connections from *listener* to the port *target*, and keeps the bytes."""

    def __init__(self, listener: socket.socket, target: int) -> None:
        self.data = bytearray()
        self._target = ("127.0.0.1", target)
        self._listener = listener
        self._open = [listener]
        self._threads: list[threading.Thread] = []
        self._start(self._accept)

    def _start(self, target: Callable[..., None], *args: socket.socket) -> None:
        self._threads.append(threading.Thread(target=target, args=args, daemon=True))
        self._threads[-1].start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                self._open.append(client)
                robot = socket.create_connection(self._target)
                self._open.append(robot)
                self._start(self._copy, client, robot)
                self._start(self._copy, robot, client)

    def _copy(self, source: socket.socket, target: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(1 << 16):
                self.data += data
                target.sendall(data)
            target.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        for peer in self._open:
            with suppress(OSError):
                peer.shutdown(socket.SHUT_RDWR)  # on Linux, close() does not end accept() of another thread
        self._listener.close()  # elsewhere, shutdown() does not
        for thread in self._threads:
            thread.join()
        for peer in self._open:
            peer.close()


def listeners_in_a_row(count: int) -> list[socket.socket]:
    """Return sockets that listen on consecutive ports."""
    for first in range(33_000, 60_000, count):
        with ExitStack() as stack, suppress(OSError):
            sockets = [
                stack.enter_context(socket.create_server(("127.0.0.1", first + at))) for at in range(count)
            ]
            stack.pop_all()
            return sockets
    raise AssertionError


@pytest.mark.parametrize("encrypted", [False, True])
def test_the_bytes_on_the_wire_are_unreadable_with_keys(
    endless: btcore.Tree, robot_keys: RobotKeys, desk: ClientKeys, encrypted: bool
) -> None:
    keys, client_keys = (robot_keys, desk) if encrypted else (None, None)
    with ExitStack() as stack:
        publisher = stack.enter_context(serve(endless, groot2_port=0, keys=keys, allow_control=True))
        listeners = listeners_in_a_row(3)
        relays = [Relay(listener, publisher.port + at) for at, listener in enumerate(listeners)]
        for relay in relays:
            stack.callback(relay.close)
        address = f"tcp://127.0.0.1:{listeners[0].getsockname()[1]}"
        watch(endless, address, client_keys)
        with BreakpointClient(address, keys=client_keys) as robot:
            robot.break_at("step")
            assert len(robot.hooks()) == 1
        requests, _, scene = (bytes(relay.data) for relay in relays)
    assert len(requests) > 1000
    assert len(scene) > 1000
    readable = not encrypted
    assert (b"Endless" in scene) is readable
    assert (b"Endless" in requests) is readable
    assert (b"desired_status" in requests) is readable


def test_clients_without_keys_can_watch_where_it_is_asked_for(
    endless: btcore.Tree, robot_keys: RobotKeys, desk: ClientKeys
) -> None:
    with serve(endless, groot2_port=0, keys=robot_keys, allow_control=True, watch_port=0) as publisher:
        how, name, _ = watch(endless, publisher.watch_address, None)
        assert (how, name) == (f"{publisher.watch_address}, by btcore's run channel", "Endless")
        with (
            BreakpointClient(publisher.watch_address) as unknown_client,
            BreakpointClient(publisher.address, keys=desk) as client,
        ):
            assert unknown_client.statuses()["step"] == "IDLE"
            for change in (
                lambda: unknown_client.break_at("step"),
                unknown_client.clear,
                unknown_client.disable,
                unknown_client.hooks,
            ):
                with pytest.raises(BreakpointError, match="hooks need a key"):
                    change()
            client.break_at("step")
            with pytest.raises(BreakpointError, match="hooks need a key"):
                unknown_client.release("step")
            assert len(client.hooks()) == 1


@pytest.mark.parametrize(
    "ports", [{"groot2_port": None, "groot1_port": 0}, {"groot2_port": 0, "groot1_port": 0}]
)
def test_groot_1_watches_without_keys_if_allowed(
    endless: btcore.Tree, robot_keys: RobotKeys, ports: dict[str, int | None] | dict[str, int]
) -> None:
    with serve(endless, **ports, keys=robot_keys, watch_port=0) as publisher:
        address = f"tcp://127.0.0.1:{publisher.watch_groot1_port}"
        with connected(address, zmq.SUB, None) as (groot, event):
            assert event == zmq.EVENT_HANDSHAKE_SUCCEEDED
            # A subscription takes effect a moment later, so the first update can be missed.
            endless.tick_exactly_once()
            while not groot.poll(50):
                endless.tick_exactly_once()
            assert groot.recv()


def test_watch_port_in_use_is_named(endless: btcore.Tree, sample: btcore.Tree, robot_keys: RobotKeys) -> None:
    with (
        serve(sample, groot2_port=0) as other,
        pytest.raises(
            ServeError, match=f"port {other.port} is in use: choose another port with --watch-port"
        ),
    ):
        serve(endless, groot2_port=0, keys=robot_keys, watch_port=other.port)


def test_a_watch_port_needs_keys(endless: btcore.Tree) -> None:
    with pytest.raises(ServeError, match="no effect, because there are no keys"):
        serve(endless, groot2_port=0, watch_port=0)


@pytest.mark.parametrize("bind", ["*", "0.0.0.0"])
def test_publishing_to_the_network_without_keys_warns_once(
    endless: btcore.Tree, robot_keys: RobotKeys, caplog: pytest.LogCaptureFixture, bind: str
) -> None:
    caplog.set_level(logging.WARNING, "monitor")
    with serve(endless, groot2_port=0, bind=bind):
        pass
    [warning] = caplog.messages
    assert f"published at '{bind}' without keys: every program that reaches the port can watch" in warning
    caplog.clear()
    with (
        serve(endless, groot2_port=0),
        serve(endless, groot2_port=0, bind=bind, keys=robot_keys, allow_control=True),
    ):
        pass
    assert caplog.messages == []


def test_control_over_the_network_needs_keys_or_insecure(
    endless: btcore.Tree, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(ServeError, match=r"control from the network \('\*'\) needs keys: .*--insecure"):
        serve(endless, groot2_port=0, bind="*", allow_control=True)
    assert caplog.messages == []
    with (
        serve(endless, groot2_port=0, bind="*", allow_control=True, insecure=True) as publisher,
        BreakpointClient(publisher.address) as robot,
    ):
        assert robot.break_at("step") == ["step"]
    [warning] = caplog.messages
    assert "can control the tree" in warning
