"""Where a recording goes: a viewer's window, a viewer elsewhere, a file, a browser."""

import contextlib
import importlib.util
import socket
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote, urlsplit

import rerun as rr

from btcore_monitor.display import has_display
from btcore_monitor.errors import MonitorError
from btcore_monitor.screen.page import PageServer, free_port


class ScreenError(MonitorError):
    """What was asked of the screen can't be had here; the message says what can."""


@dataclass(slots=True)
class RecordingSinks:
    """Where recordings go. *save* is an ``.rrd`` file (a robot's second tree goes to ``NAME.2.rrd``, and so
    on); *viewer* the address of a running viewer or relay, from :func:`open_window` or :func:`serve_web`.
    """

    save: Path | None = None
    viewer: str | None = None
    keep: object = None
    """What has to live as long as the sinks do (a served web view)."""
    _trees: int = field(default=0, init=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False)

    def attach(self, recording: rr.RecordingStream) -> Path | None:
        """Send *recording* to every outlet; returns the file it is written to, if one is."""
        with self._lock:
            self._trees += 1
            count = self._trees
        sinks: list[rr.FileSink | rr.GrpcSink] = []
        file = self.save
        if file is not None:
            if count > 1:
                file = file.with_name(f"{file.stem}.{count}{file.suffix}")
            sinks.append(rr.FileSink(file))
        if self.viewer is not None:
            sinks.append(rr.GrpcSink(self.viewer))
        if sinks:
            recording.set_sinks(*sinks)
        return file


def viewer_program() -> Path:
    """The viewer itself. ``bin/rerun`` is a wrapper that would leave it running when ended."""
    found = importlib.util.find_spec("rerun_cli")
    places = list(found.submodule_search_locations or []) if found else []
    for place in places:
        for name in ("rerun", "rerun.exe"):
            program = Path(place) / name
            if program.exists():
                return program
    raise ScreenError("the rerun viewer is not installed: pip install 'btcore[monitor]' brings it")


def open_window(memory_limit: str = "25%", port: int = 9876, files: Sequence[Path] = ()) -> str:
    """Start the viewer (or find the one on *port*), have it open *files*, and return its address.

    It stays open when we go: what was seen can be looked through. Raises ScreenError without a display.
    """
    if not has_display():
        raise ScreenError(
            "there is no display here. Use --serve-web to look from a browser, --save FILE.rrd to look "
            "later, or --screenshot FILE.png for a picture"
        )
    from rerun.experimental import ViewerClient

    client = ViewerClient.spawn(
        port=port,
        memory_limit=memory_limit,
        hide_welcome_screen=True,
        executable_path=str(viewer_program()),
    )
    if files:
        client.open([str(file.resolve()) for file in files])
    return client.url


def is_viewer_open(address: str) -> bool:
    """Whether a viewer listens at *address* (``rerun+http://HOST:PORT/proxy``); a closed one does not."""
    place = urlsplit(address)
    with contextlib.suppress(OSError), socket.create_connection((place.hostname, place.port), timeout=1.0):
        return True
    return False


@dataclass(slots=True)
class WebView:
    """A web viewer being served. *page* is for the browser, *address* for recordings. Keep it alive."""

    page: str
    address: str
    _relay: rr.RecordingStream
    _server: PageServer

    def show(self, files: Sequence[Path]) -> None:
        """Hand the recordings in *files* to whoever looks."""
        for file in files:
            self._relay.log_file_from_path(file)


def serve_web(web_port: int = 9090, grpc_port: int = 9876, memory_limit: str = "25%") -> WebView:
    """Serve the web viewer on *web_port*, to browsers of this machine; opens none.

    The relay for recordings is on *grpc_port*, or another one if that is taken. Raises ScreenError.
    """
    relay = rr.RecordingStream("btcore")
    source = free_port()
    try:
        server = PageServer(web_port, source)
        relayed = free_port(grpc_port)
        address = rr.serve_grpc(recording=relay, grpc_port=relayed, server_memory_limit=memory_limit)
        rr.serve_web_viewer(web_port=source, open_browser=False, connect_to=address)
    except (RuntimeError, OSError) as fault:
        raise ScreenError(f"the web viewer can't be served on port {web_port}: {fault}") from fault
    page = f"http://127.0.0.1:{web_port}/?hide_welcome_screen&url={quote(address, safe='')}"
    return WebView(page, address, relay, server)
