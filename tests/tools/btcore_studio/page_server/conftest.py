"""A studio in a thread, and clients that are its pages."""

import asyncio
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import AsyncExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from btcore.entry_points import LIMIT_VARIABLE
from btcore_studio.page_server.server import StudioServer
from btcore_studio.page_server.session import Shown, StudioSession

TREE = """<root BTCPP_format="4" main_tree_to_execute="Rounds">
  <BehaviorTree ID="Rounds">
    <Sequence name="Küche &lt;img src=x onerror=alert(1)&gt;">
      <Script code="tempo := 3"/>
      <AlwaysSuccess/>
    </Sequence>
  </BehaviorTree>
</root>
"""


class PageClient:
    """A page, as far as the server sees it."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.notifications: list[dict[str, Any]] = []
        self._last_id = 0

    def send(self, message: Any) -> None:
        self.socket.send(message if isinstance(message, str | bytes) else json.dumps(message))

    def receive(self, timeout: float = 60) -> dict[str, Any]:
        data: dict[str, Any] = json.loads(self.socket.recv(timeout))
        return data

    def reply_to(self, method: str, params: Any = None) -> dict[str, Any]:
        """Send a request, and return the reply with its result or error."""
        self._last_id += 1
        self.send({"jsonrpc": "2.0", "id": self._last_id, "method": method, "params": params or {}})
        while True:
            message = self.receive()
            if message.get("id") == self._last_id and "method" not in message:
                return message
            self.notifications.append(message)

    def request(self, method: str, params: Any = None) -> Any:
        reply = self.reply_to(method, params)
        assert "error" not in reply, reply
        return reply["result"]

    def error(self, method: str, params: Any = None) -> tuple[int, str]:
        error = self.reply_to(method, params)["error"]
        return error["code"], error["message"]

    def notification(self, method: str, timeout: float = 60) -> Any:
        """Return the parameters of the next notification of a method."""
        while True:
            for index, message in enumerate(self.notifications):
                if message.get("method") == method:
                    return self.notifications.pop(index)["params"]
            self.notifications.append(self.receive(timeout))


class Studio:
    """A running studio."""

    def __init__(self, session: StudioSession, server: StudioServer, loop: asyncio.AbstractEventLoop) -> None:
        self.session = session
        self.server = server
        self.loop = loop
        self.folder = session.files.folder

    @property
    def host(self) -> str:
        return self.server.url.split("/")[2]

    def uri(self, name: str) -> str:
        return (self.folder / name).as_uri()

    @contextmanager
    def page(self) -> Iterator[PageClient]:
        url = self.server.url.replace("http:", "ws:") + "socket"
        with connect(url, origin=f"http://{self.host}", max_size=None, compression=None) as socket:  # type: ignore[arg-type]
            yield PageClient(socket)


@contextmanager
def running_studio(shown: Shown, previous: Path, page: Path) -> Iterator[Studio]:
    started: list[Studio] = []
    is_ready = threading.Event()
    stops: list[Callable[[], object]] = []

    async def serve() -> None:
        stop, loop = asyncio.Event(), asyncio.get_running_loop()
        stops.append(lambda: loop.call_soon_threadsafe(stop.set))
        async with AsyncExitStack() as opened:
            session = await opened.enter_async_context(StudioSession(shown, previous))
            server = await opened.enter_async_context(StudioServer(session, 0, page))
            started.append(Studio(session, server, loop))
            is_ready.set()
            await stop.wait()

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    assert is_ready.wait(60)
    try:
        yield started[0]
    finally:
        stops[0]()
        thread.join(60)
        assert not thread.is_alive()


@pytest.fixture(autouse=True)
def no_node_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the studio import no installed libraries of nodes, which takes longer than most tests."""
    monkeypatch.setenv(LIMIT_VARIABLE, "studio robot recorder mcap btrec.txt")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "project"
    folder.mkdir()
    (folder / "tree.xml").write_bytes(TREE.encode())
    return folder


@pytest.fixture
def built(tmp_path: Path) -> Path:
    """A page of no content: the server's tests need no built page."""
    page = tmp_path / "page"
    page.mkdir()
    (page / "index.html").write_text("<!doctype html>\n<html><head></head><body></body></html>\n")
    (page / "studio.js").write_text("'use strict';\n")
    (page / "studio.css").write_text("body { margin: 0 }\n")
    (page / "notes.txt").write_text("not served\n")
    return page


@pytest.fixture
def previous(tmp_path: Path) -> Path:
    previous = tmp_path / "previous"
    previous.mkdir()
    return previous


@pytest.fixture
def studio(folder: Path, built: Path, previous: Path) -> Iterator[Studio]:
    with running_studio(Shown(folder), previous, built) as studio:
        yield studio
