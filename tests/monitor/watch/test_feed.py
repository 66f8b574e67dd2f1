"""Watching a robot that starts, stops and restarts, by both of its protocols."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any

import pytest
import zmq

import btcore
from btcore import SimClock
from btcore_monitor.events import (
    BlackboardEvent,
    ConnectionEvent,
    Event,
    ExceptionEvent,
    LostTransitionsEvent,
    MovingSceneEvent,
    ObservedTree,
    StaticSceneEvent,
    TickEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.serve import Publisher, serve
from btcore_monitor.serve.gateway_process import MAX_CONNECTIONS
from btcore_monitor.watch import feed, run_channel_client, run_channel_feed
from btcore_monitor.watch.address import AddressError, parse_address
from btcore_monitor.watch.feed import Feed
from btcore_monitor.watch.groot2_client import Groot2Client, NoReplyError
from btcore_monitor.watch.run_channel_client import RunChannelClient
from btcore_monitor.wire import run_channel as wire
from btcore_monitor.wire.fulltree import read_fulltree
from btcore_monitor.wire.groot2 import Request, StatusRecord, decode_statuses
from btcore_scene import Box, Frame, MovingScene, Picture, Scan, StaticScene
from tests.monitor.conftest import Changes
from tests.monitor.watch.conftest import Watcher

pytestmark = pytest.mark.usefixtures("no_threads_left")


class Scene:
    """A resource that can be shown."""

    def static_scene(self) -> StaticScene:
        wall = Box(name="wall", size=(1, 2, 3), position=(0, 0, 1.5))
        return StaticScene(frame="map", parts=[wall])

    def moving_scene(self) -> MovingScene:
        frame = Frame("base_link", "map", (0, 0, 0), (0, 0, 0, 1))
        return MovingScene(stamp=5, frames=[frame], scan=Scan(ranges=b"\x00\x00\x80\x3f"))


def fulltree(client: Groot2Client) -> ObservedTree:
    reply = client.request(Request.FULLTREE)
    return read_fulltree(reply.body, reply.tree_id)


def statuses(client: Groot2Client) -> dict[int, StatusRecord]:
    return decode_statuses(client.request(Request.STATUS).body)


def numbers(watcher: Any) -> list[int]:
    return [event.number for event in watcher.of(TransitionEvent)]


class Cameras(Scene):
    """A scene with an invalid picture, which is left out, and a valid picture."""

    def moving_scene(self) -> MovingScene:
        torn = Picture(name="torn", size=(4, 2), format="rgb8", data=bytes(23))
        whole = Picture(name="whole", size=(4, 2), format="rgb8", data=bytes(24))
        return replace(super().moving_scene(), pictures=[torn, whole])


def test_a_picture_of_the_wrong_size_is_left_out_with_one_warning(
    sample: btcore.Tree,
    watch: Callable[..., Watcher],
    until: Callable[..., None],
    caplog: pytest.LogCaptureFixture,
) -> None:
    with serve(sample, groot2_port=0, resources=[Cameras()]) as publisher:
        watcher = watch(publisher.address)
        assert publisher.wait_for_clients(1, 60)
        while sample.tick_exactly_once() is btcore.Status.RUNNING:
            sample.clock.advance(1.0)
        publisher.end_stream()
        until(watcher.ended, "the end of the stream")
    scenes = [event.data for event in watcher.of(MovingSceneEvent)]
    assert len(scenes) > 1
    assert {tuple(picture.name for picture in scene.pictures) for scene in scenes} == {("whole",)}
    assert all(scene.frames for scene in scenes)
    assert [record.getMessage() for record in caplog.records] == [
        "the picture 'torn' can't be sent and is left out: "
        "ValueError('4 × 2 rgb8 pixels have 24 bytes, not 23')"
    ]


def test_a_viewer_that_starts_before_the_robot_sees_everything(
    sample: btcore.Tree, watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with serve(sample, groot2_port=0) as publisher:
        port = publisher.port
    early = watch(f":{port}")
    until(lambda: early.of(ConnectionEvent), "the message that no robot answers")
    assert early.events[0] == ConnectionEvent("waiting", f"waiting for the robot at tcp://127.0.0.1:{port}")
    with serve(sample, groot2_port=port, resources=[Scene()]) as publisher:
        assert publisher.wait_for_clients(1, 60)
        for _ in range(3):
            sample.tick_exactly_once()
    until(early.ended, "the end of the stream")

    seen = early.of(TreeEvent)[0]
    assert seen.tree.tree_id == publisher.tree_id
    assert seen.tree.name == "Main"
    assert set(seen.statuses.values()) == {0}
    assert numbers(early) == list(range(1, len(numbers(early)) + 1))
    assert early.steps[:5] == [(1, 0, 1), (2, 0, 2), (3, 0, 1), (4, 0, 3), (5, 0, 1)]
    assert [event.tick for event in early.of(TickEvent)] == [1, 2, 3]
    assert early.of(StaticSceneEvent)[0].data.frame == "map"
    assert early.of(MovingSceneEvent)[0].data.scan.ranges == b"\x00\x00\x80\x3f"
    assert early.of(BlackboardEvent)[-1].boards["Sub::6"]["mode"] == "fast"
    assert early.links == ["waiting", "connected", "ended"]
    assert not early.of(LostTransitionsEvent)


@contextmanager
def strangers(publisher: Publisher, count: int) -> Iterator[Callable[[], None]]:
    """*count* other clients of the run channel, until the function is called or the context ends."""
    with zmq.Context() as context, ExitStack() as clients:
        for number in range(count):
            client = clients.enter_context(context.socket(zmq.SUB))
            client.subscribe(b"presence/%d" % number)
            client.connect(f"tcp://127.0.0.1:{publisher.port + wire.PORT_OFFSET}")
        assert publisher.wait_for_clients(count, 60)
        yield clients.close


@pytest.mark.parametrize(("protocol", "is_late"), [("groot2", True), ("groot1", True), ("groot2", False)])
def test_a_robot_with_a_run_channel_is_not_sampled_meanwhile(
    endless: btcore.Tree, monkeypatch: pytest.MonkeyPatch, protocol: str, is_late: bool
) -> None:
    """On a busy machine, the run channel may be later than Groot's replies, or silent for seconds."""
    if not is_late:
        monkeypatch.setattr(run_channel_feed, "SILENT_AFTER_S", 0.0)
    events: list[Event] = []
    with ExitStack() as stack:
        publisher = stack.enter_context(serve(endless, **{"groot2_port": None, f"{protocol}_port": 0}))
        leave = stack.enter_context(strangers(publisher, MAX_CONNECTIONS if is_late else 0))
        viewer = stack.enter_context(Feed(publisher.address))
        deadline = time.monotonic() + 60
        while viewer._state is feed._State.SEARCHING and time.monotonic() < deadline:
            events += viewer.poll(0.01)
        for _ in range(20):
            endless.tick_exactly_once()
            events += viewer.poll(0.01)
        leave()
        publisher.end_stream()
        events += viewer.events(until_end=True)
        publisher.close()
    assert len([event for event in events if isinstance(event, TreeEvent)]) == 1
    found = [event.number for event in events if isinstance(event, TransitionEvent)]
    assert found == list(range(1, len(found) + 1))
    assert [event.tick for event in events if isinstance(event, TickEvent)] == list(range(1, 21))


def test_a_robot_whose_run_channel_is_not_reachable_is_sampled(
    endless: btcore.Tree, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(feed, "ANNOUNCED_RUN_CHANNEL_WAIT_S", 0.0)
    with ExitStack() as stack:
        publisher = stack.enter_context(serve(endless, groot2_port=0))
        leave = stack.enter_context(strangers(publisher, MAX_CONNECTIONS))
        viewer = stack.enter_context(Feed(publisher.address))
        connected = next(
            event for event in viewer if isinstance(event, ConnectionEvent) and event.state == "connected"
        )
        port = publisher.port
        assert connected.detail == (
            f"tcp://127.0.0.1:{port}, by Groot 2's protocol, because there is no reply from its run "
            f"channel, tcp://127.0.0.1:{port + 2}"
        )
        assert not next(event for event in viewer if isinstance(event, TreeEvent)).has_transition_numbers
        leave()
        # A run channel that can be reached again begins with the tree.
        assert next(event for event in viewer if isinstance(event, TreeEvent)).has_transition_numbers


def test_a_late_reply_to_a_request_for_missing_messages_is_used(
    monkeypatch: pytest.MonkeyPatch, until: Callable[..., None]
) -> None:
    """With many clients or on a busy machine, a reply takes longer than the pause between two requests."""
    monkeypatch.setattr(run_channel_client, "_RETRY_AFTER_S", 0.0)
    context: zmq.Context = zmq.Context()
    with context.socket(zmq.XPUB) as robot:
        address = parse_address(f":{robot.bind_to_random_port('tcp://127.0.0.1') - wire.PORT_OFFSET}")
        client = RunChannelClient(address)
        topics: list[bytes] = []

        def is_requested(topic: bytes) -> bool:
            client.read()
            while robot.poll(0):
                topics.append(robot.recv())
            return any(request.startswith(b"\x01" + topic) for request in topics)

        try:
            until(lambda: is_requested(b"request/tree/"), "the request for the tree")
            (topic,) = (topic[1:] for topic in topics if topic.startswith(b"\x01request/tree/"))
            robot.send_multipart([topic, wire.encode(wire.TreeMessage("a", 0, 0, b"<root/>", 1, 1, {}))])
            until(lambda: is_requested(b"request/1/"), "the request for the first message")
            topic = next(topic[1:] for topic in topics if topic.startswith(b"\x01request/1/"))
            client.read()
            ticks = wire.encode(wire.TransitionsMessage("a", 1, 0, 0, 1, 0, 1, True, 1, []))
            robot.send_multipart([topic, wire.encode(wire.PieceMessage("a", 1, 1, 1, [ticks]))])
            received: list[wire.Message] = []
            until(lambda: received.extend(client.read()) or received, "the message")
            assert [message.seq for message in received if isinstance(message, wire.TransitionsMessage)] == [
                1
            ]
        finally:
            client.close()
    context.term()


def test_closing_waits_for_a_client_that_does_not_read_for_some_time(
    endless: btcore.Tree,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    until: Callable[..., None],
) -> None:
    monkeypatch.setattr("btcore_monitor.serve.publisher._ANNOUNCE_AFTER_S", 0.01, raising=False)
    with serve(endless, groot2_port=0) as publisher, Feed(publisher.address) as viewer:
        events: list[Event] = []
        until(lambda: events.extend(viewer.poll(0.01)) or publisher.client_count, "the client")
        for _ in range(20):
            endless.tick_exactly_once()
        closing = threading.Thread(target=publisher.close)
        closing.start()
        until(lambda: caplog.messages or not closing.is_alive(), "a warning")
        assert caplog.messages == [
            "waiting up to 29.99 s until 1 clients have received the end of the run; Ctrl-C ends the wait"
        ]
        events += viewer.events(until_end=True)
        closing.join()
    assert [event.tick for event in events if isinstance(event, TickEvent)] == list(range(1, 21))


def test_a_viewer_that_connects_during_a_run_gets_the_earlier_events(
    endless: btcore.Tree, watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with serve(endless, groot2_port=0) as publisher:
        for _ in range(50):
            endless.tick_exactly_once()
        late = watch(publisher.address)
        until(lambda: len(late.of(TickEvent)) == 50, "the transitions before")
        for _ in range(50):
            endless.tick_exactly_once()
        until(lambda: len(late.of(TickEvent)) == 100, "the next transitions")
        assert numbers(late) == list(range(1, len(numbers(late)) + 1))


def test_a_viewer_that_connects_after_the_last_tick_gets_the_run(
    sample: btcore.Tree, watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with serve(sample, groot2_port=0) as publisher:
        for _ in range(3):
            sample.tick_exactly_once()
        sample.halt()
        publisher.end_stream()
        late = watch(publisher.address)
        until(late.ended, "the end of the stream")
        assert len(late.of(TickEvent)) == 3
        assert late.of(TransitionEvent)[-1].status == 0


def test_slow_viewers_of_a_fast_tree_miss_no_transition(
    endless: btcore.Tree, watch: Callable[..., Watcher], until: Callable[..., None], changes: type[Changes]
) -> None:
    reported = changes(endless)
    with serve(endless, groot2_port=0, grace=60) as publisher:
        viewers = [watch(publisher.address), watch(publisher.address, pause=0.002)]
        assert publisher.wait_for_clients(2, 10)
        for tick in range(1000):
            endless.tick_exactly_once()
            if tick == 500:
                viewers.append(watch(publisher.address, pause=0.001))
        endless.halt()
        total = reported.count
        assert total > 5000
    until(lambda: all(viewer.ended() for viewer in viewers), "the end of all streams")
    for viewer in viewers:
        assert numbers(viewer) == list(range(1, total + 1))
        assert [event.tick for event in viewer.of(TickEvent)] == list(range(1, 1001))
        assert not viewer.of(LostTransitionsEvent)
    assert publisher.dropped_transitions == 0


def test_a_robot_that_restarts_shows_its_new_tree(
    sample: btcore.Tree, endless: btcore.Tree, watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with serve(sample, groot2_port=0) as first:
        viewer = watch(first.address)
        until(lambda: viewer.of(TreeEvent), "the first tree")
    with serve(endless, groot2_port=first.port) as second:
        until(lambda: len(viewer.of(TreeEvent)) == 2, "the second tree")
        endless.tick_exactly_once()
        until(lambda: viewer.of(TickEvent), "a tick of the second tree")
    trees = [event.tree for event in viewer.of(TreeEvent)]
    assert [tree.name for tree in trees] == ["Main", "Endless"]
    assert trees[1].tree_id == second.tree_id
    assert viewer.links[:4] == ["waiting", "connected", "ended", "connected"]


def test_a_replaced_tree_is_seen_on_the_same_connection(
    sample: btcore.Tree,
    endless: btcore.Tree,
    watch: Callable[..., Watcher],
    until: Callable[..., None],
    changes: type[Changes],
) -> None:
    changes_before, changes_after = changes(sample), changes(endless)
    with serve(sample, groot2_port=0, resources=[Scene()]) as publisher:
        viewer = watch(publisher.address)
        until(lambda: viewer.of(TreeEvent), "the first tree")
        sample.tick_exactly_once()
        sample.halt()
        publisher.replace_tree(endless)
        for _ in range(100):
            endless.tick_exactly_once()
        assert publisher.client_count == 1
        second = publisher.tree_id
    until(viewer.ended, "the end of the stream")
    seen = viewer.of(TreeEvent)
    assert [event.tree.name for event in seen] == ["Main", "Endless"]
    assert seen[1].tree.tree_id == second
    assert viewer.links[-2:] == ["connected", "ended"], "no connection was lost"
    kinds = [type(event) for event in viewer.events]
    assert kinds.index(StaticSceneEvent, viewer.events.index(seen[1]))
    before = [
        event for event in viewer.events[: viewer.events.index(seen[1])] if isinstance(event, TransitionEvent)
    ]
    after = numbers(viewer)[len(before) :]
    assert [change.number for change in before] == list(range(1, changes_before.count + 1))
    assert before[-1].status == 0, "the last halt of the first tree is not lost"
    assert after == list(range(1, changes_after.count + 1))
    assert [event.tick for event in viewer.of(TickEvent)] == [1, *range(1, 101)]


def test_a_groot2_client_sees_the_next_tree_at_once(sample: btcore.Tree, endless: btcore.Tree) -> None:
    with (
        serve(sample, groot2_port=0) as publisher,
        Groot2Client(parse_address(publisher.address), timeout=60) as client,
    ):
        first = fulltree(client)
        publisher.replace_tree(endless)
        endless.tick_exactly_once()
        second = fulltree(client)
        assert (first.name, second.name) == ("Main", "Endless")
        assert second.tree_id == publisher.tree_id != first.tree_id
        assert statuses(client).keys() == {node.uid for node in endless.nodes}


def test_a_heartbeat_of_an_unknown_tree_makes_the_client_request_the_tree(until: Callable[..., None]) -> None:
    """A client whose queue overflowed when the tree changed must receive the new tree."""
    context: zmq.Context = zmq.Context()
    with context.socket(zmq.XPUB) as robot:
        address = parse_address(f":{robot.bind_to_random_port('tcp://127.0.0.1') - wire.PORT_OFFSET}")
        client = RunChannelClient(address)

        def question() -> bytes:
            received_messages = [b""]

            def is_requested() -> bool:
                # The client repeats its request after some time only, because a reply may be on its way.
                robot.send_multipart([wire.HEARTBEAT_TOPIC, wire.encode(wire.HeartbeatMessage("second", 0))])
                client.read()
                while robot.poll(0) and not received_messages[-1].startswith(b"\x01request/tree/"):
                    received_messages.append(robot.recv())
                return received_messages[-1].startswith(b"\x01request/tree/")

            until(is_requested, "a request")
            return received_messages[-1][1:]

        try:
            for name in ("first", "second"):
                topic = question()
                tree = wire.TreeMessage(name, 0, 0, b"<root/>", 1, 0, {})
                robot.send_multipart([topic, wire.encode(tree)])
                until(client.read, "the tree")
                assert client.tree_id == name
        finally:
            client.close()
    context.term()


def test_the_exception_of_a_node_arrives(watch: Callable[..., Watcher], until: Callable[..., None]) -> None:
    registry = btcore.Registry.standard()

    @btcore.action
    def explode() -> bool:
        raise ValueError("boom")

    registry.add(explode)
    xml = '<root BTCPP_format="4"><BehaviorTree ID="M"><Explode name="fuse"/></BehaviorTree></root>'
    tree = btcore.loads(xml, nodes=registry, resources=[SimClock()])
    with serve(tree, groot2_port=0) as publisher:
        viewer = watch(publisher.address)
        assert publisher.wait_for_clients(1, 60)
        with pytest.raises(btcore.NodeExecutionError):
            tree.tick_exactly_once()
        until(lambda: viewer.of(ExceptionEvent), "the error")
    assert viewer.of(ExceptionEvent)[0].path == "fuse"
    assert "boom" in viewer.of(ExceptionEvent)[0].message


def test_transitions_of_an_unfinished_tick_are_shown(
    watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    go_on = threading.Event()
    registry = btcore.Registry.standard()

    @btcore.action
    def block() -> bool:
        return go_on.wait(60)

    registry.add(block)
    xml = "<Sequence><AlwaysSuccess/><Block/></Sequence>"
    xml = f'<root BTCPP_format="4"><BehaviorTree ID="M">{xml}</BehaviorTree></root>'
    tree = btcore.loads(xml, nodes=registry)
    with serve(tree, groot2_port=0) as publisher:
        viewer = watch(publisher.address)
        ticking = threading.Thread(target=tree.tick_exactly_once)
        ticking.start()
        try:
            until(lambda: viewer.of(TransitionEvent), "the first child's success")
            assert not viewer.of(TickEvent)
        finally:
            go_on.set()
            ticking.join()


def test_a_hanging_viewer_does_not_delay_the_end(endless: btcore.Tree) -> None:
    with zmq.Context() as context, context.socket(zmq.SUB) as hanging:
        with serve(endless, groot2_port=0, grace=0.1) as publisher:
            hanging.setsockopt(zmq.RCVHWM, 1)
            hanging.subscribe(b"")
            hanging.subscribe(b"presence/hanging")
            hanging.connect(f"tcp://127.0.0.1:{publisher.port + 2}")
            assert publisher.wait_for_clients(1, 60)
            for _ in range(500):
                endless.tick_exactly_once()
            began = time.monotonic()
        assert time.monotonic() - began < 60


def test_a_client_of_a_silent_robot_raises_and_can_request_again(sample: btcore.Tree) -> None:
    with serve(sample, groot2_port=0) as publisher:
        port = publisher.port
    with Groot2Client(parse_address(f":{port}"), timeout=0.05) as client:
        with pytest.raises(NoReplyError, match=f"no answer from tcp://127.0.0.1:{port} in 0.05 s"):
            client.request(Request.STATUS)
        client.timeout = 60
        with serve(sample, groot2_port=port):
            assert len(statuses(client)) == 10


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("tcp://robot.local:1700", ("robot.local", 1700)),
        ("robot.local", ("robot.local", 1667)),
        ("1700", ("127.0.0.1", 1700)),
        (":1700", ("127.0.0.1", 1700)),
        ("tcp://[::1]:1700", ("[::1]", 1700)),
        ("10.0.0.7/", ("10.0.0.7", 1667)),
    ],
)
def test_an_address_may_be_short(text: str, where: tuple[str, int]) -> None:
    assert parse_address(text)[:2] == where


@pytest.mark.parametrize("text", ["http://robot", "a b", "robot:port", "robot:99999", "65534", "::1"])
def test_an_invalid_address_raises(text: str) -> None:
    with pytest.raises(AddressError, match=r"is not an address|out of range"):
        parse_address(text)
