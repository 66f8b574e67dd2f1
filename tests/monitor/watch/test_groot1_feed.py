"""Watching a robot that uses Groot 1's protocol: BehaviorTree.CPP 3's as captured, and ours."""

import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import zmq

import btcore
from btcore_monitor.events import ConnectionEvent, MissingDataEvent, TickEvent, TransitionEvent, TreeEvent
from btcore_monitor.serve import serve
from btcore_monitor.watch.address import parse_address
from btcore_monitor.watch.groot2_client import Groot1DetectedError, Groot2Client
from btcore_monitor.wire.groot1 import WireTransition, encode_update
from btcore_monitor.wire.groot1_tree import WireModel, WireNode, WireTree, encode_tree
from btcore_monitor.wire.groot2 import Request
from tests.monitor.conftest import Changes
from tests.monitor.watch.conftest import Watcher

pytestmark = pytest.mark.usefixtures("no_threads_left")
CAPTURES = Path(__file__).parents[1] / "captures"
TREE = (CAPTURES / "v3_behaviortree.flatbuffer.bin").read_bytes()
UPDATES = [(CAPTURES / f"v3_pub_{number}.bin").read_bytes() for number in (1, 2, 3)]
STEPS = [
    *[(1, 0, 1), (2, 0, 2), (3, 0, 1), (4, 0, 3), (5, 0, 1)],
    *[(5, 1, 2), (4, 3, 0), (5, 2, 0), (3, 1, 2), (6, 0, 1), (7, 0, 1), (8, 0, 1)],
    *[(8, 1, 2), (8, 2, 0), (7, 1, 2), (7, 2, 0), (6, 1, 2), (9, 0, 1), (10, 0, 1), (11, 0, 1)],
]
SMALL = WireTree(
    (WireNode(1, (2,), 0, "again", "Repeat"), WireNode(2, (), 0, "look", "Look")),
    (WireModel("Repeat", 4), WireModel("Look", 2)),
)


def update(statuses: list[int], *steps: tuple[int, int, int], stamp: int = 10**18) -> bytes:
    changes = [WireTransition(stamp + 1000 * number, *step) for number, step in enumerate(steps)]
    return encode_update(enumerate(statuses, start=1), changes)


class Robot:
    """A publisher like BehaviorTree.CPP 3's: its thread ends when a request has more than one frame."""

    def __init__(self, tree: bytes, port: int = 0, apart: int = 1) -> None:
        self.tree = tree
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.replies = self.context.socket(zmq.REP)
        self.news = self.context.socket(zmq.XPUB)
        for number in [port] if port else range(21_000, 32_000, 7):
            try:
                self.news.bind(f"tcp://127.0.0.1:{number - apart}")
                self.replies.bind(f"tcp://127.0.0.1:{number}")
            except zmq.ZMQError:
                continue
            self.port = number
            break
        self.requests = 0
        self.hurt = False
        self.listeners = 0
        self.answers = True
        self._waiting: list[bytes] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        poller = zmq.Poller()
        poller.register(self.replies, zmq.POLLIN)
        poller.register(self.news, zmq.POLLIN)
        while not self._stop.is_set():
            for frame in self._waiting[:]:
                self.news.send(frame)
                self._waiting.pop(0)
            for socket, _ in poller.poll(5):
                if socket is self.news:
                    self.listeners += 1 if self.news.recv()[:1] == b"\x01" else -1
                elif self.answers:
                    self.replies.recv()
                    if self.replies.getsockopt(zmq.RCVMORE):
                        self.hurt = True
                        return
                    self.requests += 1
                    self.replies.send(self.tree)

    def publish(self, *frames: bytes) -> None:
        self._waiting += frames

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        while self._waiting:
            self.news.send(self._waiting.pop(0))
        self.news.close(linger=100)
        self.replies.close(linger=0)
        self.context.term()

    def __enter__(self) -> "Robot":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def test_a_robot_of_version_3_is_detected_and_every_transition_is_shown(
    watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with Robot(TREE) as robot:
        viewer = watch(f":{robot.port}")
        until(lambda: viewer.of(TreeEvent), "the tree")
        robot.publish(*UPDATES)
        until(lambda: len(viewer.steps) == len(STEPS), "what the robot published")
    assert not robot.hurt
    assert viewer.links[:2] == ["waiting", "connected"]
    assert viewer.of(ConnectionEvent)[1].detail == f"tcp://127.0.0.1:{robot.port}, by Groot 1's protocol"
    seen = viewer.of(TreeEvent)[0]
    assert len(seen.tree.nodes) == 11
    assert not seen.has_transition_numbers
    assert set(seen.source.unavailable) == {"ticks", "exceptions", "blackboard"}
    assert set(seen.statuses.values()) == {0}
    assert viewer.steps == STEPS
    changes = viewer.of(TransitionEvent)
    assert [change.number for change in changes] == list(range(1, len(STEPS) + 1))
    assert [change.wall for change in changes[:2]] == [1795223035621691000, 1795223035621823000]
    assert changes[7].stamp - changes[4].stamp == changes[7].wall - changes[4].wall
    assert [change.stamp for change in changes] == sorted(change.stamp for change in changes)
    assert not viewer.of(MissingDataEvent)


def test_a_viewer_that_connects_during_a_run_gets_statuses_by_the_first_update(
    watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    """The statuses in the tree are out of date, because they are those of the robot's start."""
    with Robot(TREE) as robot:
        viewer = watch(f":{robot.port}")
        until(lambda: robot.listeners == 1, "a listener")
        robot.publish(UPDATES[1])
        until(lambda: len(viewer.steps) == 7, "the update")
    assert len(viewer.of(TreeEvent)) == 1
    assert viewer.of(TreeEvent)[0].statuses == dict(zip(range(1, 12), [1, 2, 1, 3, 1] + 6 * [0], strict=True))
    assert not viewer.of(MissingDataEvent)


def test_statuses_that_arrive_late_correct_the_statuses_of_the_tree(
    watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with Robot(TREE) as robot:
        viewer = watch(f":{robot.port}")
        until(lambda: viewer.of(TreeEvent), "the tree")
        robot.publish(UPDATES[1])
        until(lambda: len(viewer.steps) == 7, "the update")
    first, second = viewer.of(TreeEvent)
    assert second.tree is first.tree, "it is the same tree"
    assert [second.statuses[uid] for uid in range(1, 6)] == [1, 2, 1, 3, 1]
    assert not viewer.of(MissingDataEvent), "nothing got lost, since nothing was known"


def test_lost_update_is_reported_as_gap(watch: Callable[..., Watcher], until: Callable[..., None]) -> None:
    with Robot(TREE) as robot:
        viewer = watch(f":{robot.port}")
        until(lambda: viewer.of(TreeEvent), "the tree")
        robot.publish(UPDATES[0], UPDATES[2])
        until(lambda: len(viewer.steps) == 13, "the updates")
    changes = viewer.of(TransitionEvent)
    assert [change.number for change in changes] == list(range(1, 14))
    again = viewer.of(TreeEvent)[1]
    (hole,) = viewer.of(MissingDataEvent)
    assert (hole.since, hole.stamp, hole.kind) == (changes[4].stamp, changes[5].stamp, "transitions")
    assert again.tree.tree_id == viewer.of(TreeEvent)[0].tree.tree_id
    assert [again.statuses[uid] for uid in range(1, 9)] == [1, 2, 2, 0, 0, 1, 1, 1]
    assert viewer.events.index(hole) < viewer.events.index(again)


def test_a_robot_that_does_not_publish_transitions_to_idle_has_no_gaps(
    watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with Robot(encode_tree(SMALL)) as robot:
        viewer = watch(f":{robot.port}")
        until(lambda: viewer.of(TreeEvent), "the tree")
        robot.publish(update([0, 0], (1, 0, 1), (2, 0, 2), (2, 0, 3)), update([1, 0], (2, 0, 2)))
        until(lambda: len(viewer.steps) == 6, "the updates")
    assert viewer.steps == [(1, 0, 1), (2, 0, 2), (2, 2, 0), (2, 0, 3), (2, 3, 0), (2, 0, 2)]
    assert not viewer.of(MissingDataEvent)


def test_a_robot_may_start_later_and_restart_with_another_tree(
    watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with Robot(TREE) as robot:
        port = robot.port
    viewer = watch(f":{port}")
    until(lambda: viewer.links == ["waiting"], "the message that no robot answers")
    with Robot(TREE, port) as robot:
        until(lambda: viewer.of(TreeEvent), "the first tree")
        robot.publish(UPDATES[0])
    with Robot(encode_tree(SMALL), port) as robot:
        until(lambda: len(viewer.of(TreeEvent)) == 2, "the second tree")
        robot.publish(update([0, 0], (1, 0, 1)))
        until(lambda: len(viewer.steps) == 6, "the second tree's transition")
    first, second = viewer.of(TreeEvent)
    assert (first.tree.name, second.tree.name) == ("root_seq", "again")
    assert first.tree.tree_id != second.tree.tree_id
    assert viewer.of(TransitionEvent)[-1].number == 1


def test_a_robot_that_restarts_with_the_same_tree_is_a_new_run(
    watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    """Groot 1 does not notice the restart, because the uids are the same."""
    with Robot(TREE) as robot:
        viewer = watch(f":{robot.port}")
        until(lambda: viewer.of(TreeEvent), "the tree")
        robot.publish(UPDATES[0], UPDATES[1])
        until(lambda: len(viewer.steps) == 12, "its transitions")
    with Robot(TREE, robot.port) as robot:
        until(lambda: len(viewer.of(TreeEvent)) == 2, "the tree again")
        robot.publish(UPDATES[0])
        until(lambda: len(viewer.steps) == 17, "its transitions again")
    first, second = viewer.of(TreeEvent)
    assert first.tree.tree_id != second.tree.tree_id
    assert set(second.statuses.values()) == {0}
    assert not viewer.of(MissingDataEvent)


def test_another_tree_in_the_same_process_is_requested(
    watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with Robot(encode_tree(SMALL)) as robot:
        viewer = watch(f":{robot.port}")
        until(lambda: viewer.of(TreeEvent), "the first tree")
        nodes = (WireNode(3, (4,), 0, "next", "Repeat"), WireNode(4, (), 0, "look", "Look"))
        robot.tree = encode_tree(SMALL._replace(nodes=nodes))
        robot.publish(encode_update([(3, 0), (4, 0)], [WireTransition(10**18, 4, 0, 2)]))
        until(lambda: viewer.steps, "its transition")
    assert [event.tree.name for event in viewer.of(TreeEvent)] == ["again", "next"]
    assert viewer.steps == [(2, 0, 2)]


def test_an_idle_robot_stays_connected_and_a_silent_robot_is_lost(
    watch: Callable[..., Watcher], until: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("btcore_monitor.watch.groot1_feed.PROBE_AFTER_S", 0.8)
    with Robot(encode_tree(SMALL)) as robot:
        viewer = watch(f":{robot.port}")
        until(lambda: viewer.of(TreeEvent), "the tree")
        requests = robot.requests
        until(lambda: robot.requests > requests, "another request")
        assert viewer.links[:2] == ["waiting", "connected"]
        until(lambda: viewer.links[-1] == "connected", "the reply, which is late if the machine stops")
        robot.answers = False
        until(lambda: viewer.links[-1] == "lost", "the loss")
        robot.answers = True
        until(lambda: viewer.links[-1] == "connected", "the return")
        robot.publish(update([1, 0], (2, 0, 2)))
        until(lambda: viewer.steps, "a transition")
    assert len({event.tree.tree_id for event in viewer.of(TreeEvent)}) == 1, "it was never disconnected"
    assert viewer.of(TreeEvent)[-1].statuses == {1: 1, 2: 0}


def test_an_invalid_update_loses_the_connection_which_is_then_restored(
    watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with Robot(encode_tree(SMALL)) as robot:
        viewer = watch(f":{robot.port}")
        until(lambda: viewer.of(TreeEvent), "the tree")
        robot.publish(b"no")
        until(lambda: "lost" in viewer.links, "the loss")
        assert "expected statuses and transitions" in viewer.of(ConnectionEvent)[2].detail
        until(lambda: viewer.links[-1] == "connected", "the return")


def test_an_unusual_publish_port_is_reported_and_can_be_given_in_the_address(
    watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with Robot(encode_tree(SMALL), apart=3) as robot:
        blind = watch(f":{robot.port}")
        until(lambda: blind.of(TreeEvent), "the tree")
        assert (
            f"nothing is published at tcp://127.0.0.1:{robot.port - 1}" in blind.of(ConnectionEvent)[1].detail
        )
        viewer = watch(f":{robot.port}/{robot.port - 3}")
        until(lambda: viewer.of(TreeEvent), "the tree")
        robot.publish(update([0, 0], (2, 0, 2)))
        until(lambda: viewer.steps, "a transition")
        assert not blind.steps


# Our publisher.


def test_every_transition_of_a_btcore_robot_arrives_by_groot1(
    endless: btcore.Tree, watch: Callable[..., Watcher], until: Callable[..., None], changes: type[Changes]
) -> None:
    reported = changes(endless)
    with serve(endless, groot2_port=None, groot1_port=0, run_channel=False) as publisher:
        viewer = watch(publisher.address)
        until(lambda: viewer.of(TreeEvent), "the tree")
        for _ in range(500):
            endless.tick_exactly_once()
        endless.halt()
        total = reported.count
        until(lambda: len(viewer.steps) == total, "all transitions")
    assert [change.number for change in viewer.of(TransitionEvent)] == list(range(1, total + 1))
    assert not viewer.of(MissingDataEvent)
    assert viewer.of(TreeEvent)[0].tree.nodes[3].name == "step"
    assert viewer.of(TreeEvent)[0].tree.by_uid.keys() == {node.uid for node in endless.nodes}


def test_the_tree_by_groot1_has_the_engines_paths(
    sample: btcore.Tree, watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with serve(sample, groot2_port=None, groot1_port=0, run_channel=False) as publisher:
        viewer = watch(publisher.address)
        until(lambda: viewer.of(TreeEvent), "the tree")
    nodes = viewer.of(TreeEvent)[0].tree.nodes
    assert [(node.uid, node.path, node.type) for node in nodes] == [
        (node.uid, node.path, node.type.name.lower()) for node in sample.nodes
    ]


def test_the_run_channel_is_preferred_to_groot1(
    endless: btcore.Tree, watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with serve(endless, groot2_port=None, groot1_port=0) as publisher:
        viewer = watch(publisher.address)
        assert publisher.wait_for_clients(1, 60)
        endless.tick_exactly_once()
        until(lambda: viewer.of(TickEvent), "a tick, which Groot 1 doesn't know")
    assert viewer.of(TreeEvent)[0].has_transition_numbers
    assert "run channel" in viewer.of(ConnectionEvent)[1].detail


def test_a_robot_may_restart_with_the_other_protocol(
    endless: btcore.Tree, watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    with serve(endless, groot2_port=None, groot1_port=0, run_channel=False) as publisher:
        port = publisher.port
        viewer = watch(publisher.address)
        until(lambda: viewer.of(TreeEvent), "the tree")
    with serve(endless, groot2_port=port, run_channel=False):
        until(lambda: len(viewer.of(TreeEvent)) == 2, "the tree by Groot 2")
        assert viewer.of(ConnectionEvent)[-1].detail.endswith("by Groot 2's protocol")
    with serve(endless, groot2_port=None, groot1_port=port - 1, run_channel=False):
        until(lambda: len(viewer.of(TreeEvent)) == 3, "the tree by Groot 1")
        assert viewer.of(ConnectionEvent)[-1].detail.endswith("by Groot 1's protocol")


def test_a_groot2_client_detects_a_robot_of_version_3_without_harm(until: Callable[..., None]) -> None:
    with Robot(TREE) as robot, Groot2Client(parse_address(f":{robot.port}"), timeout=60) as client:
        with pytest.raises(Groot1DetectedError, match="uses Groot 1's protocol"):
            client.request(Request.FULLTREE)
        with pytest.raises(Groot1DetectedError):
            client.request(Request.STATUS)
        assert not robot.hurt
        assert robot.requests == 2


def test_watching_requests_tree_only_twice(watch: Callable[..., Watcher], until: Callable[..., None]) -> None:
    """The tree is requested twice at the beginning, and not again as long as the robot publishes."""
    with Robot(encode_tree(SMALL)) as robot:
        viewer = watch(f":{robot.port}")
        until(lambda: viewer.of(TreeEvent), "the tree")
        began = time.monotonic()
        statuses = [0, 0]
        while time.monotonic() - began < 3.5:
            robot.publish(update(statuses, (2, statuses[1], 2 - statuses[1])))
            statuses[1] = 2 - statuses[1]
            seen = len(viewer.steps)
            until(lambda seen=seen: len(viewer.steps) > seen, "an update")
        assert robot.requests == 2


@pytest.mark.parametrize(
    ("text", "request_at", "published_at"),
    [
        ("", "tcp://127.0.0.1:1667", "tcp://127.0.0.1:1666"),
        ("robot:2667", "tcp://robot:2667", "tcp://robot:2666"),
        ("tcp://robot:1800/1700", "tcp://robot:1800", "tcp://robot:1700"),
        ("1800/1700", "tcp://127.0.0.1:1800", "tcp://127.0.0.1:1700"),
    ],
)
def test_address_determines_port_of_groot1s_updates(text: str, request_at: str, published_at: str) -> None:
    address = parse_address(text)
    assert (address.at(), address.published()) == (request_at, published_at)
