"""Our publisher against Groot 1's protocol, over real sockets, decoded here without our code."""

import itertools
import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import zmq
from hypothesis import given, settings
from hypothesis import strategies as st

import btcore
from btcore import Registry, SimClock, Status
from btcore.status import Transition
from btcore_monitor.serve import Publisher, ServeError, serve
from btcore_monitor.serve.groot1 import Groot1Server
from btcore_monitor.serve.queueing_observer import TransitionItem

pytestmark = pytest.mark.usefixtures("no_threads_left")
CAPTURES = Path(__file__).parents[1] / "captures"

# Fields of the tables, by the ids in BehaviorTree.CPP 3.8's BT_logger_generated.h.
TREE = {"root_uid": (0, "H"), "nodes": (1, ["node"]), "node_models": (2, ["model"])}
NODE = {
    "uid": (0, "H"),
    "children_uid": (1, ["H"]),
    "status": (2, "b"),
    "instance_name": (3, "text"),
    "registration_name": (4, "text"),
    "port_remaps": (5, ["remap"]),
}
REMAP = {"port_name": (0, "text"), "remap": (1, "text")}
MODEL = {"registration_name": (0, "text"), "type": (1, "b"), "ports": (2, ["port"])}
PORT = {"port_name": (0, "text"), "direction": (1, "b"), "type_info": (2, "text"), "description": (3, "text")}
TABLES = {"node": NODE, "remap": REMAP, "model": MODEL, "port": PORT}


def number(data: bytes, place: int, kind: str) -> int:
    # Readers in C++ access numbers in place: each number has to be aligned.
    assert place % struct.calcsize(f"<{kind}") == 0, f"a number of kind {kind} at byte {place}"
    return struct.unpack_from(f"<{kind}", data, place)[0]


def table(data: bytes, start: int, fields: dict[str, Any]) -> dict[str, Any]:
    """The table at *start*; a field that is absent is None."""
    vtable = start - number(data, start, "i")
    size = number(data, vtable, "H")
    found: dict[str, Any] = {}
    for name, (id, kind) in fields.items():
        offset = number(data, vtable + 4 + 2 * id, "H") if 4 + 2 * id < size else 0
        found[name] = value(data, start + offset, kind) if offset else None
    return found


def value(data: bytes, place: int, kind: Any) -> Any:
    if isinstance(kind, str) and kind != "text":
        return number(data, place, kind)
    start = place + number(data, place, "I")
    length = number(data, start, "I")
    start += 4
    if kind == "text":
        assert data[start + length] == 0, "a string ends with a NUL"
        return data[start : start + length].decode()
    (element,) = kind
    if element in TABLES:
        places = range(start, start + 4 * length, 4)
        return [table(data, at + number(data, at, "I"), TABLES[element]) for at in places]
    return [number(data, start + 2 * index, element) for index in range(length)]


def tree_in(data: bytes) -> dict[str, Any]:
    return table(data, number(data, 0, "I"), TREE)


@dataclass
class Message:
    """A frame of the publish socket, as docs/reference/protocols.md describes it."""

    statuses: list[tuple[int, int]]
    changes: list[tuple[int, int, int, int, int]]

    @classmethod
    def read(cls, frame: bytes) -> "Message":
        (size,) = struct.unpack_from("<I", frame)
        statuses = list(struct.iter_unpack("<Hb", frame[4 : 4 + size]))
        (count,) = struct.unpack_from("<I", frame, 4 + size)
        assert len(frame) == 8 + size + 12 * count
        return cls(statuses, list(struct.iter_unpack("<IIHbb", frame[8 + size :])))

    @property
    def steps(self) -> list[tuple[int, int, int]]:
        return [change[2:] for change in self.changes]


@dataclass
class Window:
    """A client like Groot 1: a SUB socket, and a new REQ socket for every request."""

    publisher: Publisher
    context: "zmq.Context[zmq.Socket[bytes]]"
    news: "zmq.Socket[bytes]"

    def ask(self, *frames: bytes) -> bytes:
        with self.context.socket(zmq.REQ) as socket:
            socket.setsockopt(zmq.LINGER, 0)
            socket.connect(f"tcp://127.0.0.1:{self.publisher.groot1_port + 1}")
            socket.send_multipart(frames or (b"",))
            assert socket.poll(60_000), "no reply within a minute"
            (reply,) = socket.recv_multipart()
            return reply

    def tree(self) -> dict[str, Any]:
        return tree_in(self.ask())

    def next(self) -> Message:
        assert self.news.poll(60_000), "no update within a minute"
        (frame,) = self.news.recv_multipart()
        return Message.read(frame)


@pytest.fixture
def window() -> Iterator[Callable[..., Window]]:
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    opened = []

    def window(publisher: Publisher) -> Window:
        news = context.socket(zmq.SUB)
        opened.append(news)
        links = news.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED)
        opened.append(links)
        news.subscribe(b"")
        news.connect(f"tcp://127.0.0.1:{publisher.groot1_port}")
        assert links.poll(60_000)
        news.disable_monitor()
        client = Window(publisher, context, news)
        client.ask()  # after the reply, the publisher has processed the subscription
        return client

    yield window
    for socket in opened:
        socket.close(linger=0)
    context.term()


NESTED = """
<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <ReactiveFallback name="top">
      <Inverter><SubTree ID="Sub" lim="7"/></Inverter>
      <Parallel>
        <Look name="" far="{distance}"/>
        <Greet text="übers Feld" answer="{expected_message}"/>
            <Sleep msec="100000"/>
      </Parallel>
    </ReactiveFallback>
  </BehaviorTree>
  <BehaviorTree ID="Sub">
    <Sequence><Script code="n:=1"/><AlwaysSuccess _skipIf="n==1"/></Sequence>
  </BehaviorTree>
</root>
"""


@pytest.fixture
def nested() -> btcore.Tree:
    """A tree with nodes unknown to Groot 1, ports of all directions, an empty name and non-ASCII texts."""
    nodes = Registry.standard()

    class Look(btcore.Condition):
        far: btcore.InOut[float]

        def tick(self) -> bool:
            return self.far < 5

    @btcore.action
    def greet(text: btcore.In[str], answer: btcore.Put[str]) -> bool:
        answer("hello")
        return True

    nodes.add(Look, greet)
    tree = btcore.loads(NESTED, nodes=nodes, resources=[SimClock()])
    tree.blackboard["distance"] = 2.0
    return tree


# What Groot 1 requires of the tree.


@pytest.fixture(params=["sample", "sample3", "nested"])
def flat(request: pytest.FixtureRequest, window: Callable[..., Window]) -> dict[str, Any]:
    """The tree in the publisher's reply, for each of several trees."""
    with serve(request.getfixturevalue(request.param), groot2_port=None, groot1_port=0) as publisher:
        return window(publisher).tree()


def test_the_tree_meets_groot1s_requirements(flat: dict[str, Any]) -> None:
    nodes = {node["uid"]: node for node in flat["nodes"]}
    models = {model["registration_name"]: model for model in flat["node_models"]}
    assert len(nodes) == len(flat["nodes"]) > 0
    assert len(models) == len(flat["node_models"])
    # Every vector and string is there.
    for entry in [*nodes.values(), *models.values()]:
        assert None not in entry.values()
        assert all(None not in port.values() for port in entry.get("port_remaps", entry.get("ports")))
    for node in nodes.values():
        model = models[node["registration_name"]]
        assert model["type"] in (1, 2, 3, 4, 5)
        assert (model["type"] in (1, 2)) == (not node["children_uid"])
        assert model["type"] not in (4, 5) or len(node["children_uid"]) == 1
        declared = {port["port_name"] for port in model["ports"]}
        assert {remap["port_name"] for remap in node["port_remaps"]} <= declared
    # The first node is the root, the order is depth-first, and every child is in the list once.
    order = []
    waiting = [flat["root_uid"]]
    while waiting:
        order.append(waiting.pop())
        waiting += reversed(nodes[order[-1]]["children_uid"])
    assert order == list(nodes) == sorted(order)
    assert 0 < order[0] <= order[-1] <= 0xFFFF


def test_nodes_unknown_to_groot1_have_their_ports_and_types(
    nested: btcore.Tree, window: Callable[..., Window]
) -> None:
    with serve(nested, groot2_port=None, groot1_port=0) as publisher:
        flat = window(publisher).tree()
    models = {model["registration_name"]: model for model in flat["node_models"]}
    assert models["Look"]["type"] == 2
    assert [tuple(port.values())[:3] for port in models["Look"]["ports"]] == [("far", 2, "double")]
    assert models["Greet"]["type"] == 1
    assert [tuple(port.values())[:3] for port in models["Greet"]["ports"]] == [
        ("text", 0, "std::string"),
        ("answer", 1, "std::string"),
    ]
    assert models["Script"]["type"] == 1
    assert models["SubTree"]["ports"] == []
    by_name = {node["instance_name"]: node for node in flat["nodes"]}
    assert by_name["Greet"]["port_remaps"] == [
        {"port_name": "text", "remap": "übers Feld"},
        {"port_name": "answer", "remap": "{expected_message}"},
    ]
    # a port that is input and output comes twice, as in the original
    assert [remap["remap"] for remap in by_name[""]["port_remaps"]] == ["{distance}", "{distance}"]
    assert by_name["Sub"]["registration_name"] == "SubTree"
    assert by_name["Sub"]["port_remaps"] == []


def test_a_skipped_node_is_idle_and_no_status_beyond_failure_is_sent(
    nested: btcore.Tree, window: Callable[..., Window]
) -> None:
    with serve(nested, groot2_port=None, groot1_port=0) as publisher:
        groot = window(publisher)
        nested.tick_exactly_once()
        message = groot.next()
        nested.halt()
        messages = [message, groot.next()]
    codes = [status for message in messages for _, status in message.statuses]
    codes += [status for message in messages for *_, previous, status in message.changes]
    assert set(codes) <= {0, 1, 2, 3}
    skipped = next(node.uid for node in nested.nodes if node.name == "AlwaysSuccess")
    assert not [step for message in messages for step in message.steps if step[0] == skipped]


def test_every_uid_of_a_message_is_in_the_tree_and_all_nodes_have_a_status(
    endless: btcore.Tree, window: Callable[..., Window]
) -> None:
    with serve(endless, groot2_port=None, groot1_port=0) as publisher:
        groot = window(publisher)
        uids = [node["uid"] for node in groot.tree()["nodes"]]
        for _ in range(3):
            endless.tick_exactly_once()
            message = groot.next()
            assert [uid for uid, _ in message.statuses] == uids
            assert {uid for uid, *_ in message.steps} <= set(uids)


def test_a_replaced_tree_has_new_uids_so_that_groot1_requests_it(
    endless: btcore.Tree, sample: btcore.Tree, window: Callable[..., Window]
) -> None:
    with serve(endless, groot2_port=None, groot1_port=0) as publisher:
        groot = window(publisher)
        before = groot.tree()
        endless.tick_exactly_once()
        endless.halt()
        publisher.replace_tree(sample)
        sample.tick_exactly_once()
        known = {node["uid"] for node in before["nodes"]}
        messages = [groot.next()]
        while {uid for uid, _ in messages[-1].statuses} == known:
            messages.append(groot.next())
        assert messages[-2].steps[-1][2] == 0, "the last halt of the first tree is not lost"
        assert not {uid for uid, _ in messages[-1].statuses} & known
        after = groot.tree()
    assert [uid for uid, _ in messages[-1].statuses] == [node["uid"] for node in after["nodes"]]
    assert after["nodes"][0]["instance_name"] == "root_seq"


# What the original sends.


def test_the_tree_equals_the_originals(sample3: btcore.Tree, window: Callable[..., Window]) -> None:
    original = tree_in((CAPTURES / "v3_behaviortree.flatbuffer.bin").read_bytes())
    with serve(sample3, groot2_port=None, groot1_port=0) as publisher:
        ours = window(publisher).tree()
    for node in original["nodes"]:
        assert node["status"] is None, "the original leaves a 0 out"
        node["status"] = 0
    assert ours["root_uid"] == original["root_uid"]
    assert ours["nodes"] == original["nodes"]
    signatures = [
        {
            model["registration_name"]: (
                model["type"],
                {(port["port_name"], port["direction"] or 0, port["type_info"]) for port in model["ports"]},
            )
            for model in tree["node_models"]
        }
        for tree in (original, ours)
    ]
    assert signatures[0] == signatures[1]


def test_updates_equal_the_originals_bytes(sample3: btcore.Tree) -> None:
    """Tick by tick, with the original's times."""
    captured = [(CAPTURES / f"v3_pub_{number}.bin").read_bytes() for number in (1, 2, 3)]
    server = Groot1Server(sample3)
    received: list[Transition] = []

    class Recorder(btcore.Observer):
        def transition(self, change: Transition) -> None:
            received.append(change)

    sample3.subscribe(Recorder())
    for frame in captured:
        stamps = [(change[0] * 1_000_000 + change[1]) * 1_000 for change in Message.read(frame).changes]
        while len(received) < len(stamps):
            assert sample3.ticks < 5
            sample3.tick_exactly_once()
        for change, stamp in zip(received, stamps, strict=True):
            server.add_transition(TransitionItem(change, stamp), 0.0)
        received.clear()
        assert server.update(1.0) == frame


def test_random_requests_are_answered_with_tree(sample: btcore.Tree, window: Callable[..., Window]) -> None:
    with serve(sample, groot2_port=None, groot1_port=0) as publisher:
        groot = window(publisher)
        tree = groot.ask()
        assert publisher.groot1_port is not None
        # One socket for all requests, because creating a socket takes longer than a request.
        with groot.context.socket(zmq.REQ) as socket:
            socket.setsockopt(zmq.LINGER, 0)
            socket.connect(f"tcp://127.0.0.1:{publisher.groot1_port + 1}")

            @given(st.lists(st.binary(max_size=40), min_size=1, max_size=4))
            @settings(max_examples=2 * settings().max_examples, database=None)
            def noise(frames: list[bytes]) -> None:
                socket.send_multipart(frames)
                assert socket.poll(60_000), "no reply within a minute"
                assert socket.recv_multipart() == [tree]

            noise()
        sample.tick_exactly_once()
        assert groot.next().steps


def test_tree_has_current_statuses_of_nodes(sample: btcore.Tree, window: Callable[..., Window]) -> None:
    with serve(sample, groot2_port=None, groot1_port=0) as publisher:
        groot = window(publisher)
        assert {node["status"] for node in groot.tree()["nodes"]} == {0}
        sample.tick_exactly_once()
        assert [node["status"] for node in groot.tree()["nodes"]] == [
            int(node.status) for node in sample.nodes
        ]


def test_transitions_have_the_time_of_day(endless: btcore.Tree, window: Callable[..., Window]) -> None:
    with serve(endless, groot2_port=None, groot1_port=0) as publisher:
        groot = window(publisher)
        before = time.time_ns() // 1000
        endless.tick_exactly_once()
        stamps = [change[0] * 1_000_000 + change[1] for change in groot.next().changes]
    assert before <= stamps[0] <= stamps[-1] <= time.time_ns() // 1000
    assert stamps == sorted(stamps)


def test_an_update_has_the_statuses_at_the_end_of_the_previous_update(
    endless: btcore.Tree, window: Callable[..., Window]
) -> None:
    with serve(endless, groot2_port=None, groot1_port=0) as publisher:
        groot = window(publisher)
        known = {node.uid: 0 for node in endless.nodes}
        for _ in range(20):
            endless.tick_exactly_once()
            message = groot.next()
            assert dict(message.statuses) == known
            for uid, previous, status in message.steps:
                assert known[uid] == previous
                known[uid] = status


# The throttle, by the publisher's clock.


def change_of(tree: btcore.Tree, number: int, status: Status) -> TransitionItem:
    return TransitionItem(Transition(number, 0, 1, tree.root.uid, Status.IDLE, status), number)


def test_an_update_is_sent_one_period_after_its_first_transition(endless: btcore.Tree) -> None:
    server = Groot1Server(endless, rate=25)
    assert server.update(100.0) is None, "nothing happened, so nothing is sent"
    server.add_transition(change_of(endless, 1, Status.RUNNING), 100.0)
    server.add_transition(change_of(endless, 2, Status.SUCCESS), 100.03)
    assert server.update(100.039) is None
    frame = server.update(100.041)
    assert frame is not None
    assert Message.read(frame).steps == [(1, 0, 1), (1, 1, 2)]
    assert server.update(200.0) is None


def test_a_fast_tree_does_not_exceed_the_update_rate(endless: btcore.Tree) -> None:
    server = Groot1Server(endless, rate=25)
    sent = []
    for millisecond in range(1000):
        now = millisecond / 1000
        status = Status.RUNNING if millisecond % 2 else Status.SUCCESS
        server.add_transition(change_of(endless, millisecond, status), now)
        frame = server.update(now)
        if frame is not None:
            sent.append((now, len(Message.read(frame).changes)))
    assert 20 <= len(sent) <= 25
    assert all(later[0] - earlier[0] >= 0.04 for earlier, later in itertools.pairwise(sent))
    assert sum(count for _, count in sent) >= 950, "throttling leaves no transition out"


def test_last_transitions_are_sent_before_end(sample: btcore.Tree, window: Callable[..., Window]) -> None:
    with serve(sample, groot2_port=None, groot1_port=0) as publisher:
        groot = window(publisher)
        sample.tick_exactly_once()
    assert groot.next().steps == [(1, 0, 1), (2, 0, 2), (3, 0, 1), (4, 0, 3), (5, 0, 1)]


def test_a_publisher_that_lost_transitions_sends_corrections(endless: btcore.Tree) -> None:
    server = Groot1Server(endless)
    server.add_transition(change_of(endless, 1, Status.RUNNING), 0.0)
    server.correct_statuses({1: 2, 2: 1, 3: 0}, 5_000, 0.0)
    frame = server.update(1.0)
    assert frame is not None
    assert Message.read(frame).steps == [(1, 0, 1), (1, 1, 2), (2, 0, 1)]


def test_uids_start_again_at_1_when_they_would_exceed_16_bits(endless: btcore.Tree) -> None:
    count = len(endless.nodes)
    last = Groot1Server(endless, offset=0xFFFF - count)
    assert [node["uid"] for node in tree_in(last.answer())["nodes"]][-1] == last.end == 0xFFFF
    again = Groot1Server(endless, offset=last.end)
    assert [node["uid"] for node in tree_in(again.answer())["nodes"]] == list(range(1, count + 1))


# Ports.


def test_groot1_alone_has_the_run_channel_two_ports_above_its_requests(sample: btcore.Tree) -> None:
    with serve(sample, groot2_port=None, groot1_port=0) as publisher:
        assert publisher.groot1_port is not None
        assert publisher.port == publisher.groot1_port + 1
        assert publisher.address == f"tcp://127.0.0.1:{publisher.port}"
        with zmq.Context() as context, context.socket(zmq.REP) as other:
            other.bind(f"tcp://127.0.0.1:{publisher.port + 1}")
            with pytest.raises(zmq.ZMQError):
                other.bind(f"tcp://127.0.0.1:{publisher.port + 2}")


@pytest.mark.parametrize("groot1", [1666, 1669])
def test_overlapping_ports_are_refused_before_anything_is_opened(sample: btcore.Tree, groot1: int) -> None:
    with pytest.raises(ServeError, match=r"needs the ports 1667 to 1669 and Groot 1 needs .* such as 2666"):
        serve(sample, groot2_port=1667, groot1_port=groot1)
