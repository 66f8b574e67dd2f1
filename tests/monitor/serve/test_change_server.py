"""Clients set entries of a running tree, over real sockets, and only where the robot allows it."""

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zmq

import btcore
from btcore_monitor.breakpoints import BreakpointClient
from btcore_monitor.keys import ClientKeys, RobotKeys, create_keys
from btcore_monitor.serve import ServeError, change_queue, serve
from btcore_monitor.serve.change_server import NEEDS_OPTION
from btcore_monitor.watch.address import parse_address
from btcore_monitor.watch.change_client import FOREIGN, GROOT1, ChangeClient, ChangeError

pytestmark = pytest.mark.usefixtures("no_threads_left")
XML = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence>
      <Sleep name="pause" msec="{pause}"/>
      <Script name="count" code="laps := laps + 1"/>
      <SubTree ID="Inner" name="inner"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Inner"><Script code="door := 'open'"/></BehaviorTree>
</root>"""


@pytest.fixture
def tree() -> btcore.Tree:
    tree = btcore.loads(XML, clock=btcore.SimClock())
    tree.blackboard["pause"] = 0
    tree.blackboard.set("laps", 0, btcore.values.ANY)
    return tree


@contextmanager
def client_of(address: str, keys: ClientKeys | None = None) -> Iterator[ChangeClient]:
    with ChangeClient(parse_address(address), keys) as client:
        yield client


def refusals_of(client: ChangeClient, until: Callable[..., None]) -> dict[str, str]:
    found: list[dict[str, str]] = []

    def read() -> bool:
        if (refusals := client.read_refusals()) is not None:
            found.append(dict(refusals))
        return bool(found)

    until(read, "the reply")
    return found[0]


@contextmanager
def ticking(tree: btcore.Tree) -> Iterator[None]:
    """Tick on a thread, again and again."""
    end = threading.Event()

    def tick() -> None:
        while not end.wait(0.001):
            tree.tick_once()

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join(60)


def test_an_entry_is_set_before_a_tick_with_the_type_of_its_port(tree: btcore.Tree) -> None:
    with serve(tree, groot2_port=0, allow_changes=True) as publisher, client_of(publisher.address) as client:
        with ticking(tree):
            client.set_entry("", "pause", "5")
            client.set_entry("", "laps", "100")
            client.set_entry("inner", "door", "closed")
            for wrong, message in [
                (("", "pause", "long"), "'pause' is not set: 'long' is not an integer"),
                (("", "paus", "5"), "no entry 'paus'; did you mean 'pause'?"),
                (("outer", "door", "x"), "no subtree 'outer'"),
                (("", "laps", "1" * 10_001), "longer than 10,000 characters"),
                (("", "laps", "[" * 2_000), "not set"),
            ]:
                with pytest.raises(ChangeError, match=message.replace("?", r"\?")):
                    client.set_entry(*wrong)
        tree.tick_once()
        assert tree.blackboard["pause"] == 5
        assert tree.blackboard["laps"] >= 100
        entry = tree.blackboard.find("laps")
        assert entry is not None
        assert not entry.declared.strong, "a script may write any value to it"


def test_an_entry_is_set_while_the_tree_waits_at_a_breakpoint(tree: btcore.Tree) -> None:
    with (
        serve(tree, groot2_port=0, allow_control=True, allow_changes=True) as publisher,
        client_of(publisher.address) as client,
        BreakpointClient(publisher.address) as robot,
    ):
        robot.break_at("count")
        tick = threading.Thread(target=tree.tick_once)
        tick.start()
        assert robot.wait(60).path == "count"
        client.set_entry("", "laps", "41")
        assert tree.blackboard["laps"] == 41
        with pytest.raises(ChangeError, match="only `btcore run` can reload"):
            client.replace_tree("<root/>")
        robot.release("count", remove=True)
        tick.join(60)
        assert tree.blackboard["laps"] == 42


def test_a_change_that_no_tick_executes_is_refused_and_never_takes_effect(
    tree: btcore.Tree, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(change_queue, "MAX_WAIT_S", 0.05)
    with serve(tree, groot2_port=0, allow_changes=True) as publisher, client_of(publisher.address) as client:
        with pytest.raises(ChangeError, match="nothing was changed: the tree began no tick"):
            client.set_entry("", "pause", "5")
        tree.tick_once()
        assert tree.blackboard["pause"] == 0


def test_changes_need_permission(tree: btcore.Tree, until: Callable[..., None]) -> None:
    with (
        serve(tree, groot2_port=0, allow_control=True) as publisher,
        client_of(publisher.address) as client,
        ticking(tree),
    ):
        assert refusals_of(client, until) == {
            "breakpoints": "",
            "values": NEEDS_OPTION,
            "reload": NEEDS_OPTION,
        }
        for change in (lambda: client.set_entry("", "pause", "5"), lambda: client.replace_tree("<root/>")):
            with pytest.raises(ChangeError, match="--allow-changes"):
                change()
    assert tree.blackboard["pause"] == 0


def test_changes_from_the_network_need_keys_also_if_insecure(tree: btcore.Tree) -> None:
    with pytest.raises(ServeError, match=r"changes from the network .* need keys"):
        serve(tree, groot2_port=0, bind="*", allow_control=True, allow_changes=True, insecure=True)


def test_only_clients_with_a_key_change_a_robot_with_keys(
    tree: btcore.Tree, tmp_path: Path, until: Callable[..., None]
) -> None:
    for name in ("robot", "desk"):
        create_keys(tmp_path / name)
    keys = RobotKeys(tmp_path / "robot", [tmp_path / "desk.pub"])
    desk = ClientKeys(tmp_path / "desk", tmp_path / "robot.pub")
    with (
        serve(
            tree, groot2_port=0, keys=keys, watch_port=0, allow_control=True, allow_changes=True
        ) as publisher,
        ticking(tree),
    ):
        with client_of(publisher.watch_address) as visitor:
            assert all("for watching without keys" in why for why in refusals_of(visitor, until).values())
            with pytest.raises(ChangeError, match="for watching without keys"):
                visitor.set_entry("", "pause", "7")
        with client_of(publisher.address, desk) as client:
            client.set_entry("", "pause", "5")
    assert tree.blackboard["pause"] == 5


def test_a_robot_of_another_kind_is_recognised(until: Callable[..., None]) -> None:
    """BehaviorTree.CPP 4 replies with this error to unknown requests, version 3 with its tree."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    robot = context.socket(zmq.REP)
    port = robot.bind_to_random_port("tcp://127.0.0.1")

    def reply() -> None:
        for _ in range(2):
            robot.recv_multipart()
            robot.send_multipart([b"error", b"Request not recognized"])

    thread = threading.Thread(target=reply)
    thread.start()
    with client_of(f"tcp://127.0.0.1:{port}") as client:
        assert refusals_of(client, until) == {"breakpoints": "", "values": FOREIGN, "reload": FOREIGN}
        with pytest.raises(ChangeError, match="only robots of btcore"):
            client.set_entry("", "key", "1")
    thread.join(60)
    context.destroy(linger=0)
    sample = btcore.loads(XML.replace("{pause}", "1"))
    with (
        serve(sample, groot2_port=None, groot1_port=0, run_channel=False) as publisher,
        client_of(publisher.address) as client,
    ):
        assert set(refusals_of(client, until).values()) == {GROOT1}


HOSTILE = [
    [b""],
    [b"{"],
    [b"[]"],
    [b'{"path":"","key":"pause"}'],
    [b'{"path":"","key":"pause","text":5}'],
    [b'{"path":[],"key":"pause","text":"5"}'],
    [b"\xff\xfe"],
    [b"[" * 100_000],
    [json.dumps({"path": "", "key": "pause", "text": "5"}).encode(), b"x"],
    [],
]


@pytest.mark.parametrize("kind", ["=", "<"])
def test_hostile_requests_get_an_error_reply(tree: btcore.Tree, kind: str) -> None:
    with serve(tree, groot2_port=0, allow_changes=True) as publisher:
        publisher.reload_requests.is_used = True  # type: ignore[union-attr]
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        window = context.socket(zmq.REQ)
        window.connect(publisher.address)
        for body in HOSTILE:
            if kind == "<" and len(body) == 1:
                continue  # a text with errors is refused by the run
            window.send_multipart([b"\x02" + kind.encode() + b"abcd", *body])
            assert window.poll(60_000)
            assert window.recv_multipart()[0] == b"error"
        context.destroy(linger=0)
        tree.tick_once()
        assert tree.blackboard["pause"] == 0
