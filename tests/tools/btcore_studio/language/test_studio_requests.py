"""The requests `btcore/…` as messages: valid and invalid parameters, results as JSON, and error replies."""

import asyncio
import gc
import json
import weakref
from typing import Any

import pytest

pytest.importorskip("pygls")

from btcore_studio.language import server
from btcore_studio.language.server import TreeServer, create_server
from btcore_studio.language.tree_reading import read_trees

URI = "untitled:tree.xml"
TREE = '<root BTCPP_format="4"><BehaviorTree ID="A"><Delay><Sleep msec="1"/></Delay></BehaviorTree></root>'
DOCUMENT = {"textDocument": {"uri": URI}}


class Client:
    """Sends messages to a server in this process, and keeps what it sends."""

    def __init__(self, server: TreeServer) -> None:
        self.server = server
        self.sent: list[dict[str, Any]] = []
        server.protocol.set_writer(self, include_headers=False)

    def write(self, data: bytes) -> None:
        """Keep a message of the server."""
        self.sent.append(json.loads(data))

    def send(self, message: dict[str, Any]) -> None:
        """Send a message."""
        protocol = self.server.protocol
        protocol.handle_message(protocol.structure_message({"jsonrpc": "2.0", **message}))

    def request(self, method: str, params: object) -> dict[str, Any]:
        """Return the reply to a request."""
        self.send({"id": 7, "method": method, "params": params})
        reply = self.sent.pop()
        assert (reply["id"], reply["jsonrpc"]) == (7, "2.0")
        return reply

    def result(self, method: str, params: object) -> Any:
        """Return the result of a request."""
        reply = self.request(method, params)
        assert "error" not in reply, reply["error"]["message"]
        return reply["result"]


@pytest.fixture
def client() -> Client:
    client = Client(create_server())
    client.server.project.open(URI, TREE, 1)
    return client


def test_a_drawing_is_json_data(client: Client) -> None:
    drawing = client.result("btcore/drawing", {**DOCUMENT, "tree": None, "folded": []})
    node = drawing["nodes"][1]
    for name, content in {
        "x": float,
        "y": float,
        "width": float,
        "height": float,
        "card": str,
        "edge": str,
    }.items():
        assert isinstance(node.pop(name), content)
    assert node == {
        "key": node["key"],
        "parent": 1,
        "id": "Sleep",
        "name": "Sleep",
        "kind": "action",
        "calls": "",
        "ports": [["msec", "1"]],
        "place": {"uri": URI, "position": {"line": 0, "character": TREE.index("<Sleep")}},
        "end": {"line": 0, "character": TREE.index("</Del")},
        "hidden": 0,
        "leaf": True,
        "disabled": False,
        "children": [0, 0],
    }
    assert drawing["trees"][0]["isMain"] is True
    assert "<style>" not in drawing["svg"]
    again = client.result("btcore/drawing", {**DOCUMENT, "since": drawing["number"]})
    assert (again["nodes"], len(again["moved"])) == ([], len(drawing["nodes"]))
    styled = client.result("btcore/drawing", {**DOCUMENT, "styled": True})
    assert "<style>" in styled["svg"]


@pytest.mark.parametrize(
    ("params", "reason"),
    [
        (None, "textDocument"),
        ([], "textDocument"),
        ([1], "object"),
        ({"textDocument": {}}, "uri"),
        ({**DOCUMENT, "tree": 1}, "$.tree"),
        ({**DOCUMENT, "folded": {"a": 1}}, "$.folded"),
        ({**DOCUMENT, "folded": [[]]}, "$.folded[0]"),
    ],
)
def test_invalid_parameters_get_an_error_reply(client: Client, params: object, reason: str) -> None:
    error = client.request("btcore/drawing", params)["error"]
    assert error["code"] == -32602
    assert "the parameters of btcore/drawing are invalid" in error["message"]
    assert reason in error["message"]


def test_a_document_that_cannot_be_read_gets_an_error_reply(client: Client) -> None:
    error = client.request("btcore/drawing", {"textDocument": {"uri": "file:///none.xml"}})["error"]
    assert (error["code"], "none.xml is not open" in error["message"]) == (-32803, True)


def test_a_request_without_id_is_ignored(client: Client) -> None:
    client.send({"method": "btcore/drawing", "params": {**DOCUMENT, "tree": None}})
    client.send({"method": "btcore/drawing", "params": None})
    assert client.sent == []


NOWHERE = {"line": -1, "character": 1 << 60}
SLEEP = {"uri": URI, "position": {"line": 0, "character": TREE.index("<Sleep")}}


def test_the_palette_and_the_form_are_json_data(client: Client) -> None:
    items = {item["id"]: item for item in client.result("btcore/palette", DOCUMENT)["items"]}
    assert items["Sleep"]["ports"][0] | {"about": ""} == {
        "name": "msec",
        "direction": "in",
        "type": "unsigned int",
        "default": "",
        "about": "",
    }
    form = client.result("btcore/node", SLEEP)
    assert form["fields"][1] | {"about": ""} == {
        "name": "msec",
        "group": "port",
        "text": "1",
        "direction": "in",
        "type": "unsigned int",
        "default": None,
        "isRequired": True,
        "about": "",
        "choices": [],
        "isScript": False,
    }


def test_garbage_is_collected_when_the_client_sends_nothing(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "COLLECT_AFTER_S", 0)
    monkeypatch.setattr(server, "MANY_OBJECTS", 0)

    async def read_and_forget() -> weakref.ref[object]:
        client.result("btcore/drawing", DOCUMENT)
        document = client.server.project.document(URI)
        assert document is not None
        reading = weakref.ref(read_trees(client.server.project, document).document)
        for number in range(10):
            client.server.project.open(URI, TREE.replace("1", str(number)), 2)
            client.result("btcore/drawing", DOCUMENT)
        assert reading() is not None
        for _ in range(3):
            await asyncio.sleep(0)
        return reading

    gc.disable()
    try:
        assert asyncio.run(read_and_forget())() is None
    finally:
        gc.enable()


def test_an_edit_and_a_copy_are_json_data(client: Client) -> None:
    result = client.result("btcore/edit", {"command": {"kind": "change_type", "node": SLEEP, "id": "Script"}})
    [edit] = result["edit"]["changes"][URI]
    assert edit["newText"].startswith("Script")
    assert (result["select"], result["notes"], result["drawing"]) == ([SLEEP], [], None)
    command = {"kind": "set", "node": SLEEP, "name": "_skipIf", "text": "unknown > 1"}
    result = client.result("btcore/edit", {"command": command, "drawing": DOCUMENT})
    assert (result["notes"], result["drawing"]["tree"]) == ([], "A")
    [warning] = client.result("btcore/warnings", {})["messages"]
    assert "unknown" in warning
    assert client.result("btcore/warnings", {}) == {"messages": []}
    command = {"kind": "set", "node": SLEEP, "name": "msec", "text": "fast"}
    [problem] = client.result("btcore/preview", {"command": command})["problems"]
    assert problem | {"message": ""} == {
        "severity": 1,
        "message": "",
        "data": {"attributes": ["msec"], "characters": [0, 0]},
    }
    assert client.result("btcore/copy", {"nodes": [SLEEP]}) == {"xml": '<Sleep msec="1"/>\n'}


@pytest.mark.parametrize(
    ("command", "code", "reason"),
    [
        ({"kind": "add", "parent": SLEEP, "index": 0, "id": "Sleep"}, -32803, "<Sleep> is an action"),
        ({"kind": "remove", "nodes": []}, -32803, "no node is selected"),
        ({"kind": "explode"}, -32602, "Invalid value 'explode' - at `$.command.kind`"),
        ({"kind": "add", "parent": SLEEP, "index": "0", "id": "Sleep"}, -32602, "`$.command.index`"),
        ({"kind": "add", "parent": SLEEP, "index": 0}, -32602, "missing required field `id`"),
        ({"kind": "set", "node": SLEEP, "name": "a", "text": 1}, -32602, "`$.command.text`"),
        ({"kind": "move", "nodes": [SLEEP], "parent": {"uri": URI}, "index": 0}, -32602, "`position`"),
        ({"kind": "remove", "nodes": [{"uri": URI, "position": NOWHERE}]}, -32803, "no node begins"),
    ],
)  # fmt: skip
def test_an_operation_that_cannot_be_applied_gets_an_error_reply(
    client: Client, command: dict[str, Any], code: int, reason: str
) -> None:
    error = client.request("btcore/edit", {"command": command})["error"]
    assert error["code"] == code
    assert reason in error["message"]
