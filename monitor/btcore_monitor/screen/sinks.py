"""The destinations of a recording: a viewer's window, a viewer elsewhere, a file, a browser."""

import contextlib
import importlib.util
import itertools
import socket
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote, urlsplit

import rerun as rr

from btcore_monitor.display import has_display
from btcore_monitor.errors import MonitorError
from btcore_monitor.screen.page import PageServer, free_port


class ScreenError(MonitorError):
    """The viewer, a display, a driver or a port is not available; the message names alternatives."""


@dataclass(slots=True)
class RecordingSinks:
    """The destinations of recordings.

    *save* is an ``.rrd`` file; a robot's second tree goes to ``NAME.2.rrd``, and so on. *viewer* is the
    address of a running viewer or relay, from :func:`open_window` or :func:`serve_web`.
    """

    save: Path | None = None
    viewer: str | None = None
    # next() of a counter is atomic: robots' threads may attach recordings at the same time.
    _numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1), init=False)

    def attach(self, recording: rr.RecordingStream) -> Path | None:
        """Send *recording* to all destinations, and return its file, or None without a file."""
        number = next(self._numbers)
        sinks: list[rr.FileSink | rr.GrpcSink] = []
        file = self.save
        if file is not None:
            # A file holds one recording.
            if number > 1:
                file = file.with_name(f"{file.stem}.{number}{file.suffix}")
            sinks.append(rr.FileSink(file))
        if self.viewer is not None:
            sinks.append(rr.GrpcSink(self.viewer))
        if sinks:
            recording.set_sinks(*sinks)
        return file


def viewer_program() -> Path:
    """Return the path of the viewer's executable.

    This is not ``bin/rerun``: that wrapper leaves the viewer running when the wrapper is terminated.

    Raises:
        ScreenError: The viewer is not installed.
    """
    spec = importlib.util.find_spec("rerun_cli")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        for name in ("rerun", "rerun.exe"):
            program = Path(folder) / name
            if program.exists():
                return program
    raise ScreenError("the rerun viewer is not installed: pip install 'btcore[monitor]'")


def open_window(memory_limit: str = "25%", port: int = 9876, files: Sequence[Path] = ()) -> str:
    """Start the viewer, or use a viewer that runs already. The viewer stays open when this process ends.

    Args:
        memory_limit: The maximum memory of the viewer, such as ``2GB`` or ``25%``.
        port: The viewer's port.
        files: Recordings to open.

    Returns:
        The viewer's address.

    Raises:
        ScreenError: There is no display, or the viewer is not installed.
    """
    if not has_display():
        raise ScreenError(
            "there is no display here. Use --serve-web to watch in a browser, --save FILE.rrd to watch "
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
    """Return whether a viewer listens at *address* (``rerun+http://HOST:PORT/proxy``)."""
    url = urlsplit(address)
    with contextlib.suppress(OSError), socket.create_connection((url.hostname, url.port), timeout=1.0):
        return True
    return False


@dataclass(slots=True)
class WebView:
    """A web viewer that is served as long as this object exists.

    *page* is the URL to open in a browser, *address* the URL to which recordings are sent.
    """

    page: str
    address: str
    _relay: rr.RecordingStream
    _server: PageServer

    def show(self, files: Sequence[Path]) -> None:
        """Send the recordings in *files* to all browsers."""
        for file in files:
            self._relay.log_file_from_path(file)


def serve_web(web_port: int = 9090, grpc_port: int = 9876, memory_limit: str = "25%") -> WebView:
    """Serve the web viewer to browsers of this machine, without opening a browser.

    Args:
        web_port: The port of the page.
        grpc_port: The preferred port of the relay for recordings; another port is used if it is taken.
        memory_limit: The maximum memory of the relay, such as ``2GB`` or ``25%``.

    Raises:
        ScreenError: The page cannot be served on *web_port*.
    """
    # The relay keeps recordings for browsers that connect later, up to the memory limit.
    relay = rr.RecordingStream("btcore")
    source = free_port()
    try:
        server = PageServer(web_port, source)
        relayed = free_port(grpc_port)
        address = rr.serve_grpc(recording=relay, grpc_port=relayed, server_memory_limit=memory_limit)
        rr.serve_web_viewer(web_port=source, open_browser=False, connect_to=address)
    except (RuntimeError, OSError) as error:
        raise ScreenError(f"cannot serve the web viewer on port {web_port}: {error}") from error
    page = f"http://127.0.0.1:{web_port}/?hide_welcome_screen&url={quote(address, safe='')}"
    return WebView(page, address, relay, server)
