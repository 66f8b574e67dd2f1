"""The worker process of a project, and the node libraries that it has loaded."""

import asyncio
import json
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import Awaitable, Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Protocol

from btcore.input_files import FileStamp, file_stamp
from btcore_studio.language.diagnostics import Report
from btcore_studio.language.node_models import NodeModel
from btcore_studio.language.project import DocumentKey, Project
from btcore_studio.language.worker import WorkerSettings

LOAD_LIMIT_S: Final = 30.0
"""Maximum time in which the worker must import the node libraries (s)."""
CHECK_LIMIT_S: Final = 30.0
"""Maximum time in which the worker must check a document (s)."""
MAX_ANSWER: Final = 256_000_000
"""Maximum size of an answer of the worker (bytes)."""

_LINE_END: Final = 10_000
"""A position at the end of any line: clients use the length of the line instead."""

_NOTHING: Final[Mapping[str, Any]] = {"models": [], "enums": {}}

Publish = Callable[[DocumentKey, int | None, list[Report]], None]
"""A function that is called with a file and its reports, or with a URI for a document without a file."""


class WorkerError(Exception):
    """The worker process ended, or did not answer in time."""


class CheckWorker(Protocol):
    """The server's side of the worker: a process, except where there are no processes."""

    async def ask(self, message: Mapping[str, Any], limit: float) -> dict[str, Any]:
        """Return the answer to *message*.

        Args:
            message: The settings or a request.
            limit: The maximum time (s).

        Raises:
            WorkerError: The worker ended, or did not answer in time. It is ended then.
        """
        ...

    def stop(self) -> None:
        """End the worker."""

    async def wait(self) -> None:
        """Wait until the stopped worker has ended, also if this task is cancelled in the meantime."""


StartWorker = Callable[[], Awaitable[CheckWorker]]
"""Starts a worker."""


class WorkerProcess:
    """The server's side of the worker process."""

    def __init__(self, process: Process) -> None:
        self._process = process

    @classmethod
    async def start(cls) -> "WorkerProcess":
        """Start the process. The current folder is not searched for modules."""
        command = [sys.executable, "-P", "-m", "btcore_studio.language.worker"]
        return cls(await asyncio.create_subprocess_exec(*command, stdin=PIPE, stdout=PIPE, limit=MAX_ANSWER))

    async def ask(self, message: Mapping[str, Any], limit: float) -> dict[str, Any]:
        """Return the answer to *message*. After *limit* s, end the process.

        Raises:
            WorkerError: The process ended, or did not answer in time.
        """
        writer, reader = self._process.stdin, self._process.stdout
        assert writer is not None
        assert reader is not None
        try:
            writer.write(json.dumps(message).encode() + b"\n")
            async with asyncio.timeout(limit):
                await writer.drain()
                line = await reader.readline()
            answer: dict[str, Any] = json.loads(line)
            return answer
        except TimeoutError:
            self.stop()
            raise WorkerError(f"took longer than {limit:g} s") from None
        except (OSError, ValueError) as error:
            self.stop()
            raise WorkerError("ended unexpectedly") from error

    def stop(self) -> None:
        """End the process."""
        with suppress(ProcessLookupError):
            self._process.kill()

    async def wait(self) -> None:
        """Wait until the stopped process has ended, also if this task is cancelled in the meantime.

        Otherwise the event loop could be closed before, and asyncio would print a traceback.
        """
        while self._process.returncode is None:
            with suppress(asyncio.CancelledError):
                await self._process.wait()


class LibraryWorker:
    """Checks documents with the node libraries of a project, in a process that is started if needed.

    Args:
        project: The project. It gets the models of the nodes.
        publish: Called with a file of a library and its problems.
        show: Called with a message for the user.
        refresh: Called when the available nodes changed.
        start_worker: Starts the worker that checks.

    Attributes:
        sources: The files of the libraries, each with the stamp that it had when they were loaded.
    """

    def __init__(
        self,
        project: Project,
        publish: Publish,
        show: Callable[[str], None],
        refresh: Callable[[], None],
        start_worker: StartWorker,
    ) -> None:
        self._start_worker = start_worker
        self._project = project
        self._publish = publish
        self._show = show
        self._refresh = refresh
        self._process: CheckWorker | None = None
        # The unsaved texts that the process has.
        self._sent: Mapping[Path, str] = {}
        self.sources: dict[Path, FileStamp | None] = {}
        # The problems of node libraries by file.
        self._problems: dict[Path, list[Report]] = {}
        self._last = _NOTHING
        self._distrusted = False

    @property
    def is_outdated(self) -> bool:
        """Whether a file of the loaded libraries has changed."""
        return self._process is not None and self.sources != _stamps(self.sources)

    async def load(self) -> None:
        """Start the process if there is none, and load the libraries.

        Raises:
            WorkerError: The process ended, or did not load the libraries in time.
        """
        if self._process is not None:
            return
        project = self._project
        configured = project.settings
        last = self._last if configured.trusted else _NOTHING
        settings = WorkerSettings(
            folders=list(map(str, project.folders)),
            plugins=configured.plugins,
            models=configured.models,
            given=configured.given,
            trusted=configured.trusted and not self._distrusted,
            last_models=last["models"],
            last_enums=last["enums"],
        )
        if configured.plugins and not configured.trusted:
            self._show("Python leaves are unknown: they are not imported without the setting 'trusted'.")
        self._process = process = await self._start_worker()
        self._sent = {}
        try:
            answer = await process.ask(settings._asdict(), LOAD_LIMIT_S)
        except WorkerError as error:
            if self._process is process:
                self._process = None
                if not settings.trusted:
                    raise
                self._show(f"The import of the node libraries {error}. Nodes of the last import are kept.")
                self._distrusted = True
            await self.load()
            return
        if self._process is not process:  # the settings changed meanwhile
            await self.load()
            return
        models = [NodeModel.from_data(data) for data in answer["models"]]
        project.set_models(models, answer["enums"])
        self._last = answer
        earlier = self.sources if self._distrusted else ()
        self.sources = _stamps({*map(Path, answer["sources"]), *earlier})
        self._publish_problems(answer["problems"])
        self._refresh()

    async def check(self, request: Mapping[str, Any]) -> dict[str, Any] | None:
        """Check a document, with the present texts of unsaved documents.

        Args:
            request: The file, or the text of a document without a file.

        Returns:
            The answer; None if the process was stopped meanwhile, to load the libraries again.

        Raises:
            WorkerError: The process ended, or did not answer in time.
        """
        process, unsaved = self._process, self._project.unsaved
        assert process is not None, "started by load"
        texts: dict[str, str | None] = {
            str(path): text for path, text in unsaved.items() if self._sent.get(path) is not text
        }
        texts |= {str(path): None for path in self._sent if path not in unsaved}
        self._sent = unsaved
        try:
            answer = await process.ask({**request, "texts": texts}, CHECK_LIMIT_S)
        except WorkerError:
            if process is self._process:
                raise
            return None
        return answer if process is self._process else None

    def reset(self) -> None:
        """Stop the process, and trust the libraries again."""
        self.stop()
        self._distrusted = False

    def stop(self) -> CheckWorker | None:
        """Stop the process, and return it. The next `load` starts a new process."""
        process, self._process = self._process, None
        if process is not None:
            process.stop()
        self._sent = {}
        return process

    def _publish_problems(self, problems: Iterable[tuple[str, str, int]]) -> None:
        """Publish the problems of libraries at their files and lines, and show those without a place."""
        reports: dict[Path, list[Report]] = {}
        for message, file, line in problems:
            if file:
                report = Report(file, line - 1, 0, _LINE_END, "", True, message)
                reports.setdefault(Path(file), []).append(report)
            else:
                self._show(message)
        for path in dict.fromkeys([*reports, *self._problems]):
            self._publish(path, None, reports.get(path, []))
        self._problems = reports


def _stamps(files: Iterable[Path]) -> dict[Path, FileStamp | None]:
    return {file: file_stamp(file) for file in files}
