"""The destinations of a recording: a viewer on this machine, a file, a browser."""

import contextlib
import itertools
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from urllib.parse import quote

import rerun as rr
from rerun.experimental import ViewerClient

from btcore.output_files import numbered_file
from btcore_monitor.environment_checks import has_display
from btcore_monitor.errors import RecordingError
from btcore_monitor.screen.page import PageServer, page_files
from btcore_monitor.screen.rerun_process import (
    LOOPBACK,
    RerunProcess,
    ScreenError,
    address_of,
    hold_port,
    is_listening,
    port_of,
)
from btcore_monitor.time_limits import FLUSH_TIMEOUT_S

if sys.platform != "win32":
    import resource

FLUSH_FILE_TIMEOUT_S: Final = 1.0
"""Wall time (s) for the file to receive the remaining data if the viewer was closed."""
FLUSH_STEP_S: Final = 1.0
"""Wall time (s) between two checks whether the disk is full."""
_VIEWER_PORT: Final = 9876
"""The preferred port of the viewer, and of the relay for browsers; another port is used if it is taken."""

_MIN_SPACE: Final = 1 << 14


@dataclass(frozen=True, slots=True)
class Viewer:
    """A viewer on this machine that receives recordings at *port*, and shows them in its window.

    *process* is None if the viewer was running before.
    """

    port: int
    process: RerunProcess | None = None

    @property
    def address(self) -> str:
        """The address to which recordings are sent."""
        return address_of(self.port)

    @property
    def is_open(self) -> bool:
        """Whether the viewer is running."""
        return is_listening(self.port)

    def wait_for_failure(self) -> str | None:
        """Wait as `RerunProcess.wait_for_failure` does; None also if the viewer was running before."""
        return self.process.wait_for_failure() if self.process is not None else None


@dataclass(slots=True)
class RecordingSinks:
    """The destinations of recordings.

    *save* is an `.rrd` file; a robot's second tree goes to `NAME.2.rrd`, and so on. *viewer* is a viewer
    from `open_viewer`, and *relay* the address of a relay for browsers from `serve_web`.
    """

    save: Path | None = None
    viewer: Viewer | None = None
    relay: str | None = None
    # next() of a counter is atomic: robots' threads may attach recordings at the same time.
    _numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1), init=False)
    # Kept after a failure, too: the destructor of a recording that cannot be written never returns.
    _open_files: list[tuple[rr.RecordingStream, Path]] = field(default_factory=list, init=False)

    @property
    def is_live(self) -> bool:
        """Whether a viewer shows the recordings while they are made."""
        return self.viewer is not None or self.relay is not None

    def attach(self, recording: rr.RecordingStream) -> Path | None:
        """Send *recording* to all destinations, and return its file, or None without a file."""
        number = next(self._numbers)
        sinks: list[rr.FileSink | rr.GrpcSink] = []
        file = self.save
        if file is not None:
            file = numbered_file(file, number)  # a file holds one recording
            sinks.append(rr.FileSink(file))
        if self.viewer is not None:
            sinks.append(rr.GrpcSink(self.viewer.address))
        if self.relay is not None:
            sinks.append(rr.GrpcSink(self.relay))
        if sinks:
            recording.set_sinks(*sinks)
        if file is not None:
            self._open_files.append((recording, file))
        return file

    def check_files(self) -> None:
        """Raise RecordingError if a file can no longer be written because the disk is full."""
        for _, file in self._open_files:
            if _is_full(file):
                raise _create_incomplete_error(file)

    def finish(self, recording: rr.RecordingStream) -> None:
        """Send the remaining data of *recording* to all destinations, and close it.

        Raises:
            RecordingError: The file is incomplete.
        """
        file = next((file for stream, file in self._open_files if stream is recording), None)
        is_received = self.viewer is None or self.viewer.is_open
        deadline = time.monotonic() + (FLUSH_TIMEOUT_S if is_received else FLUSH_FILE_TIMEOUT_S)
        while not _flush(recording, deadline):
            is_late = time.monotonic() >= deadline
            if file is not None and (
                _is_full(file) or (is_late and self.viewer is None and self.relay is None)
            ):
                raise _create_incomplete_error(file)
            # A viewer that was closed is no reason to leave the file unfinished.
            if is_late:
                break
        recording.disconnect()
        self._open_files = [entry for entry in self._open_files if entry[0] is not recording]


def _flush(recording: rr.RecordingStream, deadline: float) -> bool:
    """Return whether all destinations received the data of *recording*; wait at most FLUSH_STEP_S."""
    try:
        recording.flush(timeout_sec=max(min(FLUSH_STEP_S, deadline - time.monotonic()), 0.1))
    except RuntimeError:
        return False
    return True


def _create_incomplete_error(file: Path) -> RecordingError:
    reason = "no space left on the disk" if _is_full(file) else "the file cannot be written"
    return RecordingError(f"the recording {file} is incomplete: {reason}")


def _is_full(file: Path) -> bool:
    """Return whether the disk of *file* is full, or the file has reached the limit of its size."""
    with contextlib.suppress(OSError):
        free = shutil.disk_usage(file.parent).free
        if sys.platform != "win32":
            limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
            if limit != resource.RLIM_INFINITY:
                free = min(free, limit - file.stat().st_size)
        return free < _MIN_SPACE
    return False


def open_viewer(memory_limit: str = "25%", files: Sequence[Path] = (), verbose: bool = False) -> Viewer:
    """Start the viewer, or use a viewer that runs already. The viewer stays open when this process ends.

    Args:
        memory_limit: The maximum memory of the viewer, such as `2GB` or `25%`.
        files: Recordings to open.
        verbose: Whether rerun prints its log lines.

    Raises:
        ScreenError: There is no display, or the viewer is not installed, does not start or does not answer.
    """
    if not has_display():
        raise ScreenError(
            "there is no display here. Use --serve-web to watch in a browser, --save FILE.rrd to watch "
            "later, or --screenshot FILE.png for a picture"
        )
    viewer = Viewer(_VIEWER_PORT)
    if not _is_viewer(viewer.address, _VIEWER_PORT):
        options = ["--hide-welcome-screen", "--expect-data-soon", f"--memory-limit={memory_limit}"]
        process = RerunProcess(*options, port=_VIEWER_PORT, verbose=verbose)
        try:
            process.wait_until_drawing()
        except ScreenError:
            process.close()
            raise
        viewer = Viewer(process.port, process)
    if files:
        try:
            ViewerClient.connect(viewer.address).open([str(file.resolve()) for file in files])
        except OSError as error:
            raise ScreenError(f"the viewer (rerun) has not opened the recording: {error}") from error
    return viewer


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

    def send_recordings(self, files: Sequence[Path]) -> None:
        """Send the recordings in *files* to all browsers."""
        for file in files:
            self._relay.log_file_from_path(file)


def serve_web(web_port: int = 9090, grpc_port: int = _VIEWER_PORT, memory_limit: str = "25%") -> WebView:
    """Serve the web viewer to browsers of this machine, without opening a browser.

    Args:
        web_port: The port of the page.
        grpc_port: The preferred port of the relay for recordings; another port is used if it is taken.
        memory_limit: The maximum memory of the relay, such as `2GB` or `25%`.

    Raises:
        ScreenError: The page cannot be served on *web_port*.
    """
    # The relay keeps recordings for browsers that connect later, up to the memory limit.
    relay = rr.RecordingStream("btcore")
    try:
        server = PageServer(web_port, page_files())
        with hold_port(grpc_port) as held:
            sink = rr.GrpcServerSink(LOOPBACK, port_of(held), server_memory_limit=memory_limit)
            relay.set_sinks(sink)
            relay.flush(timeout_sec=FLUSH_TIMEOUT_S)  # raises RuntimeError if the relay cannot listen
    except (RuntimeError, OSError) as error:
        raise ScreenError(f"cannot serve the web viewer on port {web_port}: {error}") from error
    page = f"http://{LOOPBACK}:{web_port}/?hide_welcome_screen&url={quote(sink.uri, safe='')}"
    return WebView(page, sink.uri, relay, server)
