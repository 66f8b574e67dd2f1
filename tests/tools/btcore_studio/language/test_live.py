"""A page watches a running tree, sets breakpoints in it, and changes it."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import pytest

from btcore.errors import BtcoreError
from btcore_studio.language import live as live_module
from btcore_studio.language.live import LiveTree
from btcore_studio.language.node_keys import KeyedNode, node_keys


class Node(NamedTuple):
    uid: int
    parent: int
    id: str
    name: str
    type: str


NODES = (
    Node(1, 0, "Sequence", "round", "control"),
    Node(4, 1, "Open", "door", "action"),
    Node(5, 1, "SubTree", "visit", "subtree"),
    Node(6, 5, "SubTree", "look", "subtree"),
    Node(7, 6, "Look", "Look", "action"),
)
KEYS = node_keys(
    KeyedNode(node.uid, node.parent, node.id, node.name, node.type == "subtree") for node in NODES
)


class State(NamedTuple):
    connection: str = "connected"
    detail: str = ""
    nodes: Sequence[Node] = NODES
    trees: Mapping[int, str] = {5: "Visit", 6: "Room"}
    statuses: Mapping[int, int] = {1: 1, 4: 1}
    results: Mapping[int, int] = {}
    entries: Sequence[tuple[str, str, str]] = (("", "key", "1"),)
    breakpoints: frozenset[int] = frozenset()
    stopped_at: int = 0
    problem: str = ""
    raised_at: int = 0
    refusals: Mapping[str, str] = {"breakpoints": "", "values": "", "reload": "no reload"}
    scene: Mapping[str, Any] | None = None


@dataclass
class Connection:
    """A connection that notes what it is asked for."""

    state: State = field(default_factory=State)
    calls: list[Any] = field(default_factory=list)
    failure: str = ""

    def poll(self, timeout: float) -> State:
        if self.failure:
            raise BtcoreError(self.failure)
        return self.state

    def set_breakpoints(self, uids: Sequence[int]) -> None:
        self.calls.append(list(uids))
        self.state = self.state._replace(breakpoints=frozenset(uids), stopped_at=uids[0] if uids else 0)

    def release(self, status: str = "") -> None:
        self.calls.append(f"release {status}".strip())
        self.state = self.state._replace(stopped_at=0)

    def set_entry(self, path: str, key: str, text: str) -> None:
        if text == "invalid":
            raise BtcoreError(f"'{key}' is not set")
        self.calls.append((path, key, text))

    def replace_tree(self, xml: str) -> None:
        self.calls.append(xml)

    def close(self) -> None:
        self.calls.append("close")


class Extension:
    """Connects with the connections in `opened`, in turn."""

    address = ""

    def __init__(self, *connections: Connection) -> None:
        self.opened = list(connections)

    def connect(self, address: str) -> Connection:
        if address == "invalid":
            raise BtcoreError("the address is invalid")
        return self.opened.pop(0)


class Page:
    """Collects what is notified."""

    def __init__(self) -> None:
        self.data: dict[str, Any] = {}

    def notify(self, data: dict[str, Any]) -> None:
        self.data |= data

    async def until(self, condition: Callable[[dict[str, Any]], object]) -> None:
        async with asyncio.timeout(60):
            while not condition(self.data):
                await asyncio.sleep(0.01)


def test_states_and_breakpoints_have_the_keys_of_the_drawing() -> None:
    async def watch() -> None:
        connection, page = Connection(), Page()
        live = LiveTree(Extension(connection), page.notify)
        live.set_breakpoints([KEYS[4], "of another tree"])
        live.watch("somewhere")
        assert (page.data["address"], page.data["connection"]) == ("somewhere", "waiting")
        await page.until(lambda data: data["stopped"])
        assert page.data["stopped"] == KEYS[4]
        assert page.data["keys"] == list(KEYS.values())
        calls = [("Visit", "visit", 2), ("Room", "visit / look", 1)]
        assert [(call["tree"], call["path"], call["size"]) for call in page.data["calls"]] == calls
        assert [call["key"] for call in page.data["calls"]] == [KEYS[5], KEYS[6]]
        assert (page.data["statuses"], page.data["results"]) == ("11000", "00000")
        assert page.data["entries"] == [("", "key", "1")]
        assert page.data["breakpoints"] == [KEYS[4]]
        assert page.data["wanted"] == sorted([KEYS[4], "of another tree"])
        await live.release()
        await page.until(lambda data: not data["stopped"])
        live.set_breakpoints([])
        await page.until(lambda data: not data["breakpoints"])
        # Another tree gets the breakpoints again.
        live.set_breakpoints([KEYS[4]])
        await page.until(lambda data: data["stopped"])
        connection.state = State(nodes=NODES[:1])
        await page.until(lambda data: data["keys"] == [KEYS[1]])
        connection.state = State(nodes=tuple(NODES))
        await page.until(lambda data: data["stopped"])
        live.watch("")
        assert page.data["address"] == page.data["connection"] == ""
        await live.close()
        assert connection.calls == [[4], "release", [], [4], [], [4], "close"]

    asyncio.run(watch())


def test_status_is_forced_and_tree_is_changed() -> None:
    async def watch() -> None:
        connection, page = Connection(), Page()
        live = LiveTree(Extension(connection), page.notify)
        with pytest.raises(BtcoreError, match="no running tree is connected"):
            await live.change(lambda connection: connection.replace_tree("<root/>"))
        live.set_breakpoints([KEYS[4]])
        live.watch("somewhere")
        await page.until(lambda data: data["stopped"])
        assert page.data["refusals"] == {"breakpoints": "", "force": "", "values": "", "reload": "no reload"}
        await live.change(lambda connection: connection.set_entry("", "key", "2"))
        with pytest.raises(BtcoreError, match="'key' is not set"):
            await live.change(lambda connection: connection.set_entry("", "key", "invalid"))
        await live.change(lambda connection: connection.replace_tree("<root/>"))
        with pytest.raises(ZeroDivisionError):
            await live.change(lambda _: 1 // 0)
        await live.release("FAILURE")
        await page.until(lambda data: not data["stopped"])
        await live.close()
        assert connection.calls == [[4], ("", "key", "2"), "<root/>", "release FAILURE", "close"]
        with pytest.raises(BtcoreError, match="no running tree is connected"):
            await live.change(lambda connection: connection.replace_tree("<root/>"))

    asyncio.run(watch())


def test_scene_is_sent_when_it_has_moved() -> None:
    async def watch() -> None:
        connection, page = Connection(State(scene={"scan": [1.0]})), Page()
        live = LiveTree(Extension(connection), page.notify)
        live.watch("somewhere")
        await page.until(lambda data: data.get("scene") == {"scan": [1.0]})
        page.data["scene"] = "shown"
        connection.state = connection.state._replace(detail="the same scene")
        await page.until(lambda data: data["detail"])
        assert page.data["scene"] == "shown"
        connection.state = connection.state._replace(scene={"scan": [2.0]})
        await page.until(lambda data: data.get("scene") == {"scan": [2.0]})
        await live.close()

    asyncio.run(watch())


def test_change_is_refused_when_the_connection_fails() -> None:
    async def watch() -> None:
        connection, page = Connection(), Page()
        live = LiveTree(Extension(connection), page.notify)
        live.watch("somewhere")
        await page.until(lambda data: data["connection"] == "connected")
        connection.failure = "the robot refuses the keys"
        await page.until(lambda data: data["connection"] == "lost")
        with pytest.raises(BtcoreError, match="no running tree is connected"):
            await live.change(lambda connection: connection.replace_tree("<root/>"))
        # Breakpoints are kept for the next tree.
        live.set_breakpoints([KEYS[4]])
        assert page.data["wanted"] == [KEYS[4]]

    asyncio.run(watch())


def test_read_only_page_changes_nothing() -> None:
    async def watch() -> None:
        connection, page = Connection(), Page()
        live = LiveTree(Extension(connection), page.notify)
        live.refusal = "read-only"
        live.set_breakpoints([KEYS[4]])
        live.watch("somewhere")
        await page.until(lambda data: data["stopped"])
        assert page.data["refusals"] == {
            "breakpoints": "",
            "force": "read-only",
            "values": "read-only",
            "reload": "read-only",
        }
        with pytest.raises(BtcoreError, match="read-only"):
            await live.release("SUCCESS")
        with pytest.raises(BtcoreError, match="read-only"):
            await live.change(lambda connection: connection.set_entry("", "key", "2"))
        await live.close()
        assert connection.calls == [[4], "close"]

    asyncio.run(watch())


def test_other_address_is_watched_after_the_end_of_the_first() -> None:
    async def watch() -> None:
        first, second, page = Connection(), Connection(State(detail="second")), Page()
        live = LiveTree(Extension(first, second), page.notify)
        live.watch("first")
        await page.until(lambda data: data["connection"] == "connected")
        live.watch("second")
        await page.until(lambda data: data["detail"] == "second")
        assert first.calls == ["close"]
        await live.close()

    asyncio.run(watch())


def test_failure_of_a_connection_is_shown() -> None:
    async def watch() -> None:
        page = Page()
        live = LiveTree(Extension(Connection(failure="the robot refuses the keys")), page.notify)
        live.watch("somewhere")
        await page.until(lambda data: data["connection"] == "lost")
        assert page.data["detail"] == "the robot refuses the keys"
        live.watch("")
        await page.until(lambda data: not data["connection"])

    asyncio.run(watch())


def test_invalid_address_and_missing_package_are_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    async def watch() -> None:
        page = Page()
        with pytest.raises(BtcoreError, match="the address is invalid"):
            LiveTree(Extension(), page.notify).watch("invalid")
        monkeypatch.setattr(live_module, "find_extension", lambda: None)
        with pytest.raises(BtcoreError, match=r"btcore\[monitor\]"):
            LiveTree(None, page.notify).watch("somewhere")
        assert page.data == {}

    asyncio.run(watch())
