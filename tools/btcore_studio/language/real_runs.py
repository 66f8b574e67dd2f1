"""Runs of the edited tree with its real leaves, each in a process of its own: a leaf may hang or crash.

The process is an ordinary `btcore run`, to which the page is attached as to any running tree.
"""

import asyncio
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from btcore.errors import BtcoreError
from btcore.input_files import read_error
from btcore.signals import NEW_PROCESS_GROUP
from btcore_studio.language import real_run_child
from btcore_studio.language.live import LiveTree
from btcore_studio.language.node_models import find_model_files
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.run_options import parse_options
from btcore_studio.language.shown_runs import ShownRun, ShownRuns
from btcore_studio.language.studio_protocol import RealRunParams
from btcore_studio.language.timeline import open_timeline

UNTRUSTED: Final = (
    "real leaves are not run, because this folder is not trusted: start btcore studio with --trust, or set "
    "'trusted' in the editor"
)
_PORTS: Final = 3
"""The number of successive ports that a published run uses."""
_MAX_OUTPUT: Final = 20_000
"""The number of bytes of the output that are kept, from its end."""
_OUTPUT_INTERVAL_S: Final = 0.3
"""Minimum time (s) between two notifications with new output."""
_MAX_END_S: Final = 2 * real_run_child.GRACE_S + 2.0
"""Time (s) after which a process that was requested to end is killed."""


class RealRuns:
    """The run of a page with real leaves. All methods are called by the event loop's thread.

    Args:
        project: The project with the documents of the page.
        live: Is connected with the run.
        shown: Shows the recording of the run.
        notify: Called with the parameters of `btcore/realRun` after each change.
    """

    def __init__(
        self,
        project: Project,
        live: LiveTree,
        shown: ShownRuns,
        notify: Callable[[dict[str, Any]], None],
    ) -> None:
        self._project = project
        self._live = live
        self._shown = shown
        self._notify = notify
        self._run: _RealRun | None = None

    async def start(self, document: SourceDocument, params: RealRunParams) -> None:
        """Start a run of the text of *document*, and connect with it.

        Raises:
            BtcoreError: The folder is not trusted, an option is not permitted, or a run has not ended.
        """
        settings = self._project.settings
        if not settings.trusted:
            raise BtcoreError(UNTRUSTED)
        if self._run is not None and self._run.is_running:
            raise BtcoreError("a run with real leaves has not ended: end it first")
        options = list(parse_options(params.options))
        if params.tree is not None:
            options.append(f"--tree={params.tree}")
        folders = self._project.folders
        for plugin in settings.plugins:
            file = next((path for folder in folders if (path := folder / plugin).is_file()), None)
            options.append(f"--plugin={plugin if file is None else file}")
        for pattern in settings.models:
            options += [f"--model={file}" for file in find_model_files(pattern, folders)]
        self._forget_run()
        self._run = run = _RealRun(document, self._notify)
        try:
            await run.start(options, folders)
        except OSError as error:
            raise BtcoreError(f"the run cannot be started: {read_error(error)}") from None
        self._live.watch(run.address)

    def end_soon(self) -> None:
        """Request the end of the run."""
        if self._run is not None:
            self._run.request_end()

    async def end(self) -> None:
        """End the run, and wait for its end."""
        if self._run is not None:
            await self._run.end()

    async def open_recording(self) -> ShownRun:
        """Show the recording of the run that has ended.

        Raises:
            BtcoreError: There is no recording, or it cannot be read.
        """
        run = self._run
        if run is None or run.is_running or not run.recording.is_file():
            raise BtcoreError("there is no recording of a run with real leaves")
        opened = self._shown.add(await asyncio.to_thread(open_timeline, run.recording))
        self._live.watch("")
        return opened

    async def close(self) -> None:
        """End the run, and remove its recording."""
        await self.end()
        self._forget_run()

    def _forget_run(self) -> None:
        run, self._run = self._run, None
        if run is not None:
            run.remove_files()


class _RealRun:
    """The process of a run.

    Attributes:
        address: Where the run is published.
        recording: The file of the recording, which exists as soon as the run writes it.
        is_running: Whether the process has not ended.
    """

    def __init__(self, document: SourceDocument, notify: Callable[[dict[str, Any]], None]) -> None:
        self._notify = notify
        self._text = document.text.encode(errors="replace")
        self._cwd = None if document.path is None else document.path.parent
        # It is also removed at the end of this process.
        self._folder = TemporaryDirectory(prefix="btcore-studio-run-", ignore_cleanup_errors=True)
        self.recording = Path(self._folder.name) / "run.btrec.txt"
        self.address = ""
        self.is_running = False
        self._output = bytearray()
        self._code: int | None = None
        self._process: asyncio.subprocess.Process | None = None
        self._watching: asyncio.Task[None] | None = None

    async def start(self, options: Sequence[str], folders: Sequence[Path]) -> None:
        """Start the process. Raises OSError if that is not possible."""
        port = _find_free_ports()
        arguments = [
            *(str(len(self._text)), *map(str, folders), "--"),
            *("--publish=groot2", f"--port={port}", "--allow-control", "--allow-changes"),
            f"--record={self.recording}",
            *options,
        ]
        self._process = process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-P", "-m", real_run_child.__name__, *arguments),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=self._cwd,
            env={**os.environ, "NO_COLOR": "1", "COLUMNS": "100", "PYTHONUTF8": "1"},
            start_new_session=True,
            creationflags=NEW_PROCESS_GROUP,
        )
        self.is_running, self.address = True, f"tcp://127.0.0.1:{port}"
        assert process.stdin is not None
        process.stdin.write(self._text)
        self._publish()
        self._watching = asyncio.create_task(self._watch(process))

    def request_end(self) -> None:
        """Request the end of the process."""
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.close()

    async def end(self) -> None:
        """Request the end of the process. Kill it with all processes that it started if it does not end."""
        process, watching = self._process, self._watching
        if process is None or watching is None or not self.is_running:
            return
        self.request_end()
        with suppress(TimeoutError):
            await asyncio.wait_for(asyncio.shield(watching), _MAX_END_S)
            return
        _kill(process)
        await watching

    def remove_files(self) -> None:
        """Remove the recording."""
        self._folder.cleanup()

    async def _watch(self, process: asyncio.subprocess.Process) -> None:
        """Notify the page of the output and of the end of the process."""
        reading = asyncio.create_task(self._read(process))
        self._code = await process.wait()
        # What the leaves have started may still have the pipe.
        _kill(process)
        await reading
        self.is_running = False
        self._publish()

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        while data := await process.stdout.read(1 << 16):
            self._output += data
            del self._output[:-_MAX_OUTPUT]
            self._publish()
            await asyncio.sleep(_OUTPUT_INTERVAL_S)

    def _publish(self) -> None:
        self._notify(
            {
                "address": self.address,
                "running": self.is_running,
                "code": self._code,
                "output": self._output.decode(errors="replace"),
                "recorded": not self.is_running and self.recording.is_file(),
            }
        )


def _find_free_ports() -> int:
    """Return the first of successive ports that are free now."""
    while True:
        with ExitStack() as opened, suppress(OSError, OverflowError):
            first = 0
            for number in range(_PORTS):
                tried = opened.enter_context(socket.socket())
                tried.bind(("127.0.0.1", first and first + number))
                first = first or tried.getsockname()[1]
            return first


def _kill(process: asyncio.subprocess.Process) -> None:
    """Kill a process, and the processes that it started."""
    if sys.platform == "win32":
        with suppress(ProcessLookupError):
            process.kill()
    else:
        # The group may still have processes when its leader has ended.
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
