"""Regression tests over real sockets for bugs that users of Groot 2 reported, named after the issues."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zmq

import btcore
from btcore import Blackboard, Direction, Port, Registry, SimClock, Status, SyncAction, values
from btcore.errors import RegistrationError
from btcore.lint.validate import validate_document
from btcore.xml.models.model_file import add_models
from btcore.xml.read.read import parse_file, parse_text
from btcore_monitor.events import ObservedNode, ObservedTree
from btcore_monitor.serve import Publisher, serve
from btcore_monitor.watch.address import parse_address
from btcore_monitor.watch.groot2_client import Groot2Client
from btcore_monitor.wire import groot2
from btcore_monitor.wire.errors import RobotRefusedError
from btcore_monitor.wire.fulltree import read_fulltree
from btcore_monitor.wire.groot2 import Request, RequestHeader, decode_statuses
from btcore_monitor.wire.msgpack_values import decode_boards

Connect = Callable[[str], Groot2Client]

PLAIN = '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>'
NESTED = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence><Script code="inner := 1; own := 2"/>
      <SubTree ID="{ID}" name="{ID}" theirs="{{inner}}"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="{ID}"><Script code="theirs := theirs + 1; local := 5"/></BehaviorTree>
</root>"""


@pytest.fixture
def connect() -> Iterator[Connect]:
    clients: list[Groot2Client] = []

    def connect(address: str) -> Groot2Client:
        clients.append(Groot2Client(parse_address(address), timeout=60))
        return clients[-1]

    yield connect
    for client in clients:
        client.close()


def fulltree(client: Groot2Client) -> ObservedTree:
    reply = client.request(Request.FULLTREE)
    return read_fulltree(reply.body, reply.tree_id)


def blackboards(client: Groot2Client, name: str) -> dict[str, dict[str, Any]]:
    return decode_boards(client.request(Request.BLACKBOARD, name.encode()).body)


def published(xml: str, blackboard: Blackboard | None = None, nodes: Registry | None = None) -> Publisher:
    """Tick a tree once, and return its publisher."""
    tree = btcore.loads(xml, nodes=nodes, blackboard=blackboard, clock=SimClock())
    assert tree.tick_once() is Status.SUCCESS
    return serve(tree, groot2_port=0)


def only(nodes: tuple[ObservedNode, ...], kind: str) -> ObservedNode:
    (found,) = [node for node in nodes if node.type == kind]
    return found


# --- the blackboard ROOT


def test_cpp_pr_1168_root_blackboard_in_groot2_dump_of_tree_with_outer_blackboard(
    connect: Connect,
) -> None:
    outer = Blackboard()
    outer["shared"] = 42
    board = Blackboard(outer)
    board["own"] = 7
    with published(PLAIN, board) as publisher:
        assert blackboards(connect(publisher.address), "Main") == {"Main": {"own": 7}, "ROOT": {"shared": 42}}


def test_cpp_pr_1168_root_is_the_main_trees_blackboard_in_a_subtrees_reply(connect: Connect) -> None:
    with published(NESTED.format(ID="Inner")) as publisher:
        boards = blackboards(connect(publisher.address), "Inner")
    assert boards == {"Inner": {"local": 5}, "ROOT": {"inner": 2, "own": 2}}


def test_cpp_pr_1168_the_outermost_blackboard_has_no_root_beside_it(connect: Connect) -> None:
    board = Blackboard()
    board["own"] = 7
    with published(PLAIN, board) as publisher:
        assert blackboards(connect(publisher.address), "Main") == {"Main": {"own": 7}}


def test_cpp_pr_1168_a_subtree_named_root_is_an_error(connect: Connect) -> None:
    with published(NESTED.format(ID="ROOT")) as publisher:
        client = connect(publisher.address)
        with pytest.raises(RobotRefusedError, match="named ROOT"):
            blackboards(client, "ROOT")
        assert blackboards(client, "Main") == {"Main": {"inner": 2, "own": 2}}


# --- hooks


@pytest.mark.parametrize(
    "body",
    [
        b'{"enabled":true}',
        b'{"uid":1}',
        b'{"uid":65536,"position":99,"mode":-1}',
        b'[{"uid":1,"position":0},{}]',
        b"[]",
        b"{",
        b"",
        b"\xff" * 100_000,
    ],
    ids=["no uid", "no position", "out of bounds", "invalid item", "empty list", "no JSON", "empty", "noise"],
)
def test_cpp_pr_1170_the_publisher_survives_an_invalid_hook_insert(body: bytes, connect: Connect) -> None:
    with published(PLAIN) as publisher:
        client = connect(publisher.address)
        with pytest.raises(RobotRefusedError, match="hooks are disabled"):
            client.request(Request.HOOK_INSERT, body)
        assert fulltree(client).root.id == "AlwaysSuccess"
        assert decode_statuses(client.request(Request.STATUS).body).keys() == {1}


# --- names of ports, and of subtrees

DOTTED = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main" _fullpath="">
    <LoadController name="LoadController" _uid="1" request.name="arm" response.ok="{ok}"/>
  </BehaviorTree>
  <TreeNodesModel>
    <Action ID="LoadController">
      <input_port name="request.name" type="std::string"/>
      <output_port name="response.ok" type="bool"/>
    </Action>
  </TreeNodesModel>
</root>"""


def test_groot2_64_dots_in_port_names_of_an_older_robot_are_shown(connect: Connect) -> None:
    with zmq.Context() as context, context.socket(zmq.REP) as robot:
        port = robot.bind_to_random_port("tcp://127.0.0.1")

        def answer() -> None:
            header = RequestHeader.decode(robot.recv_multipart()[0])
            robot.send_multipart(groot2.encode_reply(header, bytes(16), DOTTED.encode()))

        answering = threading.Thread(target=answer)
        answering.start()
        node = fulltree(connect(f":{port}")).root
        answering.join()
    assert (node.id, node.type) == ("LoadController", "action")
    assert node.ports == {"request.name": "arm", "response.ok": "{ok}"}


class LoadController(SyncAction):
    @staticmethod
    def provided_ports() -> list[Port]:
        return [Port("request.name"), Port("response.ok", Direction.OUT, type=values.BOOL)]

    def tick(self) -> Status:
        return Status.SUCCESS


def test_groot2_64_dots_in_port_names_are_refused_as_in_4_10(tmp_path: Path) -> None:
    message = r"<LoadController> can't have a port called 'request\.name': it contains '\.'"
    with pytest.raises(RegistrationError, match=message):
        Registry.standard().add(LoadController)
    # A palette of an older robot can still be read, and the attributes are reported with their line.
    (tmp_path / "palette.xml").write_text(DOTTED, encoding="utf-8")
    nodes = Registry.standard()
    add_models(nodes, tmp_path / "palette.xml")
    assert list(nodes.manifests_of(4)["LoadController"].ports) == []
    assert list(nodes.manifests_of(3)["LoadController"].ports) == ["request.name", "response.ok"]
    found = validate_document(parse_file(tmp_path / "palette.xml"), nodes=nodes)
    assert [(diagnostic.code, diagnostic.line, diagnostic.message) for diagnostic in found] == [
        (
            "W212",
            3,
            f"the attribute '{port}' of <LoadController> is ignored: invalid port name (it contains '.')",
        )
        for port in ("request.name", "response.ok")
    ]


def test_groot2_40_name_on_subtree_is_its_name_and_not_a_port(connect: Connect) -> None:
    tree = NESTED.format(ID="Inner").replace('name="Inner"', 'name="patrol"')
    with published(tree) as publisher:
        client = connect(publisher.address)
        picture = fulltree(client)
        boards = blackboards(client, "patrol")
    subtree = only(picture.nodes, "subtree")
    assert (subtree.name, subtree.path) == ("patrol", "patrol")
    assert subtree.ports == {"theirs": "{inner}"}
    assert [node.subtree for node in picture.nodes] == ["", "", "", "patrol"]
    assert boards["patrol"] == {"local": 5}


def test_groot2_40_an_unused_attribute_of_a_subtree_is_reported_with_its_line() -> None:
    tree = NESTED.format(ID="Inner").replace("theirs=", 'naem="patrol" theirs=')
    (found,) = validate_document(parse_text(tree, "t.xml"), nodes=Registry.standard())
    assert (found.is_error, found.line) == (False, 4)
    assert "naem" in found.message
