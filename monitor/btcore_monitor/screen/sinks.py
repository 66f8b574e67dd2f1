"""The destinations of a recording: a viewer's window, a viewer elsewhere, a file, a browser."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

import rerun as rr
from rerun.experimental import ViewerClient

from btcore_monitor.display import has_display
from btcore_monitor.screen.page import PageServer, page_files
from btcore_monitor.screen.viewer_process import (
    LOOPBACK,
    ScreenError,
    ViewerProcess,
    address_of,
    free_port,
    is_listening,
)


@dataclass(frozen=True, slots=True)
class ViewerWindow:
    """The window of a viewer that receives recordings at *port*.

    *process* is None if the window was open before.
    """

    port: int
    process: ViewerProcess | None = None

    @property
    def address(self) -> str:
        """The address to which recordings are sent."""
        return address_of(self.port)

    @property
    def is_open(self) -> bool:
        """Whether the viewer is running."""
        return is_listening(self.port)

    def failure(self) -> str | None:
        """Return the reason why the viewer ended, or None if a user closed it."""
        return self.process.failure() if self.process is not None else None


@dataclass(slots=True)
class RecordingSinks:
    """The destinations of recordings.

    *save* is an ``.rrd`` file; a robot's second tree goes to ``NAME.2.rrd``, and so on. *window* is a window
    from :func:`open_window`, and *relay* the address of a relay for browsers from :func:`serve_web`.
    """

    save: Path | None = None
    window: ViewerWindow | None = None
    relay: str | None = None
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
        if self.window is not None:
            sinks.append(rr.GrpcSink(self.window.address))
        if self.relay is not None:
            sinks.append(rr.GrpcSink(self.relay))
        if sinks:
            recording.set_sinks(*sinks)
        return file


def open_window(
    memory_limit: str = "25%", port: int = 9876, files: Sequence[Path] = (), verbose: bool = False
) -> ViewerWindow:
    """Start the viewer, or use a viewer that runs already. The viewer stays open when this process ends.

    Args:
        memory_limit: The maximum memory of the viewer, such as ``2GB`` or ``25%``.
        port: The viewer's preferred port; another port is used if another program has it.
        files: Recordings to open.
        verbose: Whether rerun prints its log lines.

    Raises:
        ScreenError: There is no display, or the viewer is not installed or does not start.
    """
    if not has_display():
        raise ScreenError(
            "there is no display here. Use --serve-web to watch in a browser, --save FILE.rrd to watch "
            "later, or --screenshot FILE.png for a picture"
        )
    window = ViewerWindow(port)
    if not _is_viewer(window.address, port):
        options = ["--hide-welcome-screen", "--expect-data-soon", f"--memory-limit={memory_limit}"]
        process = ViewerProcess(*options, port=free_port(port), verbose=verbose)
        process.wait_until_drawing()
        window = ViewerWindow(process.port, process)
    if files:
        ViewerClient.connect(window.address).open([str(file.resolve()) for file in files])
    return window


def _is_viewer(address: str, port: int) -> bool:
    """Return whether a viewer listens at *address*, which is *port* of this machine."""
    if not is_listening(port):
        return False
    try:
        ViewerClient.connect(address).get_state()
    except (OSError, RuntimeError, ValueError):
        return False
    return True


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
    try:
        server = PageServer(web_port, page_files())
        sink = rr.GrpcServerSink(LOOPBACK, free_port(grpc_port), server_memory_limit=memory_limit)
        relay.set_sinks(sink)
    except (RuntimeError, OSError) as error:
        raise ScreenError(f"cannot serve the web viewer on port {web_port}: {error}") from error
    page = f"http://{LOOPBACK}:{web_port}/?hide_welcome_screen&url={quote(sink.uri, safe='')}"
    return WebView(page, sink.uri, relay, server)
