"""The state that all open pages of a preview share: the file, its last drawing, and the running tree."""

import json
import threading
from collections.abc import Callable, Collection, Iterator
from typing import Any, Final

from btcore.errors import BtcoreError
from btcore.extras import install_command
from btcore_studio.language.live import LiveConnection, LiveState
from btcore_studio.language.node_keys import KeyedNode, node_keys
from btcore_studio.pages.timeline import RecordedRun, Timeline
from btcore_studio.preview.tree_reading import RecordedTree, TreeFile, draw

Connect = Callable[[str], LiveConnection]
"""Returns a connection to the running tree at an address. Raises BtcoreError."""

PING_EVERY: Final = 10.0
"""Seconds after which a page without news receives an empty message, which detects closed pages."""

_LIVE_EVERY: Final = 0.1
"""Minimum time (s) between two states of the running tree."""

_MAX_BREAKPOINTS: Final = 1_000
_Event = tuple[str, dict[str, Any]]


class PreviewSession:
    """The shared state of a preview. Every method may be called from any thread.

    Args:
        file: The file.
        connect: Connects with running trees, or None if no installed package can do it.
        timeline: The recording whose tree is shown, or None.
    """

    def __init__(
        self,
        file: TreeFile | RecordedTree,
        connect: Connect | None = None,
        timeline: Timeline | None = None,
    ) -> None:
        self.file = file
        self._connect = connect
        self._recorded_run = None if timeline is None else RecordedRun(timeline)
        self._news = threading.Condition()
        self._reading_lock = threading.Lock()
        self._text: str | None = None
        self._reading = file.read()
        self._drawable = self._reading if self._reading.plans is not None else None
        self._version = self._drawn_at = 1
        self._drawing: tuple[object, bytes] | None = None
        self._address = ""
        self._live: LiveState | None = None
        self._failure = ""  # why the running tree can never be watched
        self._live_version = 0
        self._keys: dict[int, str] = {}
        self._wanted: frozenset[str] = frozenset()
        self._releases = 0
        self._thread: threading.Thread | None = None
        self._ended: threading.Event | None = None
        # The first page does not wait for its drawing.
        self.drawing(None, ())

    # --- the file

    def reload(self) -> None:
        """Read the file again, unless an editor has unsaved text."""
        if self._text is None:
            self._read(None)

    def show_text(self, text: str | None) -> None:
        """Show the unsaved *text* of an editor instead of the file; None shows the file again."""
        self._text = text
        self._read(text)

    def _read(self, text: str | None) -> None:
        with self._reading_lock:
            if text is not self._text:
                return  # a newer text is waiting
            reading = self.file.read(text)
            with self._news:
                self._reading = reading
                if reading.plans is not None:
                    self._drawable, self._drawn_at = reading, self._version + 1
                self._version += 1
                self._news.notify_all()

    def drawing(self, tree: str | None, folded: Collection[str], styled: bool = False) -> bytes:
        """Return the last drawing that was possible as the JSON text of the result of `draw`."""
        with self._news:
            drawable, drawn_at = self._drawable, self._drawn_at
        if drawable is None or drawable.plans is None:
            return json.dumps({"error": "There is no picture yet, because the file has errors."}).encode()
        shown_content = (drawn_at, tree, frozenset(folded), styled)
        with self._reading_lock:
            # Pages that load at the same time, or again, share the drawing.
            if self._drawing is None or self._drawing[0] != shown_content:
                data = draw(drawable.plans, tree, shown_content[2], styled)
                self._drawing = shown_content, json.dumps(data).encode()
            return self._drawing[1]

    # --- the running tree

    def watch(self, address: str) -> None:
        """Connect with the running tree at *address*; "" ends the connection.

        Raises:
            BtcoreError: The address is invalid, or no installed package can connect.
        """
        if address and self._connect is None:
            raise BtcoreError(f"running trees need btcore's monitor: {install_command('zmq')}")
        connection = self._connect(address) if address and self._connect is not None else None
        with self._news:
            before = self._thread
            if self._ended is not None:
                self._ended.set()
            ended = self._ended = threading.Event()
            self._address, self._live, self._failure, self._keys = address, None, "", {}
            self._live_version += 1
            self._thread = None
            if connection is not None:
                arguments = (connection, ended)
                self._thread = threading.Thread(target=self._follow, args=arguments, daemon=True)
            self._news.notify_all()
        if before is not None:
            before.join(timeout=2 * PING_EVERY)
        if self._thread is not None:
            self._thread.start()

    def set_breakpoints(self, keys: Collection[str]) -> None:
        """Set breakpoints before the nodes with these keys, and remove all others of the preview."""
        with self._news:
            wanted = frozenset(sorted(keys)[:_MAX_BREAKPOINTS])
            if wanted != self._wanted:
                self._wanted = wanted
                self._live_version += 1
                self._news.notify_all()

    def release(self) -> None:
        """Let a tree that waits at a breakpoint continue."""
        with self._news:
            self._releases += 1

    def _follow(self, connection: LiveConnection, ended: threading.Event) -> None:
        """Publish the states of a running tree until *ended* is set."""
        wanted: frozenset[str] = frozenset()
        keys: dict[int, str] = {}
        state: LiveState | None = None
        released = self._releases
        try:
            while not ended.is_set():
                before, state = state, connection.poll(_LIVE_EVERY)
                if before is None or state.nodes is not before.nodes:
                    keys = node_keys(
                        KeyedNode(node.uid, node.parent, node.id, node.name, node.type == "subtree")
                        for node in state.nodes
                    )
                    wanted = frozenset()
                if self._wanted != wanted and keys:
                    wanted = self._wanted
                    connection.set_breakpoints([uid for uid, key in keys.items() if key in wanted])
                if self._releases != released:
                    released = self._releases
                    connection.release()
                self._publish(state, keys, ended)
        except BtcoreError as error:
            self._publish(state, keys, ended, str(error))
        finally:
            connection.close()

    def _publish(
        self, state: LiveState | None, keys: dict[int, str], ended: threading.Event, failure: str = ""
    ) -> None:
        with self._news:
            if (state is not self._live or failure) and not ended.is_set():
                self._live, self._keys, self._failure = state, keys, failure
                self._live_version += 1
                self._news.notify_all()

    def moment(self, position: int) -> dict[str, Any] | None:
        """Return the recorded run after a number of steps as JSON data, or None if there is no recording."""
        return None if self._recorded_run is None else self._recorded_run.moment(position)

    # --- news for pages

    def events(self) -> Iterator[_Event | None]:
        """Yield the name and data of each event for one page, the present state first.

        Yields None every PING_EVERY seconds without an event. A slow reader misses states in between.
        """
        version = live_version = 0
        keys: dict[int, str] | None = None
        while True:
            events: list[_Event] = []
            with self._news:
                if (version, live_version) == (self._version, self._live_version):
                    self._news.wait(PING_EVERY)
                if version != self._version:
                    version = self._version
                    events.append(("document", self._document()))
                if live_version != self._live_version:
                    live_version = self._live_version
                    events.append(("live", self._live_data(with_keys=keys is not self._keys)))
                    keys = self._keys
            if events:
                yield from events
            else:
                yield None

    def _document(self) -> dict[str, Any]:
        is_current = self._reading is self._drawable
        return {
            "version": self._version,
            "file": str(self.file.path),
            "tree": self.file.tree,
            "drawable": is_current,
            "live": self._connect is not None,
            "unsaved": self._text is not None,
            "recorded": None if self._recorded_run is None else self._recorded_run.summary(),
            **self._reading.summary(),
        }

    def _live_data(self, with_keys: bool) -> dict[str, Any]:
        state = self._live
        uids = [node.uid for node in state.nodes] if state is not None else []
        data: dict[str, Any] = {
            "address": self._address,
            "connection": "waiting" if self._address else "",
            "detail": "",
            "problem": "",
            "statuses": "",
            "results": "",
            "entries": (),
            "wanted": sorted(self._wanted),
            "breakpoints": [],
            "stopped": "",
        }
        if state is not None:
            data |= {
                "connection": state.connection,
                "detail": state.detail,
                "problem": state.problem,
                "statuses": "".join(str(state.statuses.get(uid, 0)) for uid in uids),
                "results": "".join(str(state.results.get(uid, 0)) for uid in uids),
                "entries": state.entries,
                "breakpoints": [self._keys[uid] for uid in sorted(state.breakpoints) if uid in self._keys],
                "stopped": self._keys.get(state.stopped_at, ""),
            }
        if self._failure:
            data |= {"connection": "lost", "detail": self._failure}
        if with_keys:
            data["keys"] = [self._keys.get(uid, "") for uid in uids]
        return data

    def close(self) -> None:
        """End the connection with a running tree."""
        self.watch("")
