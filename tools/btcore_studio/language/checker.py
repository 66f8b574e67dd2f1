"""The background checks of a project: the worker process, the order of the checks, and their results."""

import asyncio
import json
import logging
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from btcore.input_files import FileStamp, file_stamp
from btcore_studio.language.diagnostics import Report, merge, report_from_data
from btcore_studio.language.node_models import NodeModel
from btcore_studio.language.project import (
    PROJECT_SUFFIX,
    SUFFIXES,
    DocumentKey,
    Project,
    SourceDocument,
    has_trees,
)
from btcore_studio.language.symbols import stated_format
from btcore_studio.language.worker import WorkerSettings

LOAD_LIMIT_S: Final = 30.0
"""Maximum time in which the worker must import the node libraries (s)."""
CHECK_LIMIT_S: Final = 30.0
"""Maximum time in which the worker must check a document (s)."""
PAUSE_S: Final = 0.1
"""Time between a change and the check (s). Further changes in this time need no check of their own."""
MAX_ANSWER: Final = 256_000_000
"""Maximum size of an answer of the worker (bytes)."""

_LINE_END: Final = 10_000
"""A position at the end of any line: clients use the length of the line instead."""

_NOTHING: Final[Mapping[str, Any]] = {"models": [], "enums": {}}
_log: Final = logging.getLogger(__name__)


class WorkerError(Exception):
    """The worker process ended, or did not answer in time."""


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
        """Return the answer to *message*.

        Args:
            message: The settings or a request.
            limit: The maximum time (s).

        Raises:
            WorkerError: The process ended, or did not answer in time. It is ended then.
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


class Checker:
    """Checks the documents of a project in a worker process: the changed document first, then the others.

    Args:
        project: The project.
        publish: Called with a file and its reports, or with a URI for a document without a file.
        show: Called with a message for the user.
        refresh: Called when the available nodes changed.
    """

    def __init__(
        self,
        project: Project,
        publish: Callable[[DocumentKey, int | None, list[Report]], None],
        show: Callable[[str], None],
        refresh: Callable[[], None],
    ) -> None:
        self._project = project
        self._publish = publish
        self._show = show
        self._refresh = refresh
        self._pending: dict[DocumentKey, None] = {}
        self._wake = asyncio.Event()
        self._worker: WorkerProcess | None = None
        self._sent: dict[Path, str] = {}
        # The reports of each root about each file, and the version of the file that was checked.
        self._found: dict[DocumentKey, dict[DocumentKey, tuple[int | None, list[Report]]]] = {}
        self._read: dict[DocumentKey, set[Path]] = {}
        self._sources: dict[Path, FileStamp | None] = {}
        self._shown: set[str] = set()
        # The problems of node libraries by file.
        self._library_problems: dict[Path, list[Report]] = {}
        self._last = _NOTHING
        self._distrusted = False
        self._task: asyncio.Task[None] | None = None

    # --- what to check

    def changed(self, document: SourceDocument) -> None:
        """Check *document* soon, and then the documents that include it."""
        first = self._roots_of(document)
        others = [root for root, files in self._read.items() if document.path in files and root not in first]
        self._pending = dict.fromkeys([*first, *self._pending, *others])
        self._wake.set()

    def check_all(self) -> None:
        """Check all documents: the open documents first."""
        self._pending = dict.fromkeys(
            [
                *self._pending,
                *(root for document in self._project.open_documents for root in self._roots_of(document)),
                *(root for path in self._project.files for root in self._project.roots_of(path)),
            ]
        )
        self._wake.set()

    def file_changed(self, path: Path) -> None:
        """Check what depends on a file that was created, changed or deleted on disk."""
        if path in self._sources:
            self.reload()
        roots = [root for root, read in self._read.items() if path in read]
        # Other files are Python code, or XML of other programs.
        if path in self._found or (path.suffix in SUFFIXES and has_trees(path)):
            roots = [*self._project.roots_of(path), *roots]
        self._pending |= dict.fromkeys(roots)
        self._wake.set()

    def reload(self) -> None:
        """Load the node libraries again, and check all documents."""
        self.stop()
        self._distrusted = False
        self.check_all()

    def _roots_of(self, document: SourceDocument) -> list[DocumentKey]:
        return [document.uri] if document.path is None else [*self._project.roots_of(document.path)]

    # --- checking

    def start(self) -> None:
        """Start the background task."""
        self._task = asyncio.get_running_loop().create_task(self._run())

    def close(self) -> Awaitable[object]:
        """End the background task, and then the worker process. Return an awaitable of their end."""
        tasks = [] if self._task is None else [self._task]
        for task in tasks:
            task.cancel()
        return asyncio.gather(*tasks, return_exceptions=True)

    def stop(self) -> None:
        """End the worker process. The next check starts a new process."""
        if self._worker is not None:
            self._worker.stop()
        self._worker = None
        self._sent = {}

    async def _run(self) -> None:
        try:
            await self._check_pending()
        finally:
            worker = self._worker
            self.stop()
            if worker is not None:
                await worker.wait()

    async def _check_pending(self) -> None:
        """Check what is pending, until this task is cancelled."""
        while True:
            await self._wake.wait()
            await asyncio.sleep(PAUSE_S)
            self._wake.clear()
            while self._pending:
                root = next(iter(self._pending))
                del self._pending[root]
                try:
                    await self._check(root)
                except WorkerError as error:
                    self.stop()
                    self._show_once(f"{root} cannot be checked: the check {error}.")
                except Exception:
                    _log.exception("the check of %s failed", root)

    async def _check(self, root: DocumentKey) -> None:
        worker = await self._loaded_worker()
        project = self._project
        versions: dict[DocumentKey, int | None] = {
            document.key: document.version for document in project.open_documents
        }
        unsaved = project.unsaved
        texts: dict[str, str | None] = {
            str(path): text for path, text in unsaved.items() if self._sent.get(path) is not text
        }
        texts |= {str(path): None for path in self._sent if path not in unsaved}
        self._sent = unsaved
        request: dict[str, Any] = {"file": str(root), "texts": texts}
        if isinstance(root, str):
            document = project.document(root)
            if document is None:
                self._forget(root, versions)
                return
            request |= {"file": "", "text": document.text}
        elif (root not in unsaved and not root.is_file()) or root not in project.roots_of(root):
            self._forget(root, versions)
            return
        try:
            answer = await worker.ask(request, CHECK_LIMIT_S)
        except WorkerError:
            if worker is self._worker:
                raise
        if worker is not self._worker:
            self._pending[root] = None  # the libraries are loaded again
            return
        reports_of_files: dict[DocumentKey, list[Report]] = {root: []}
        for data in answer["reports"]:
            report = report_from_data(data)
            reports_of_files.setdefault(Path(report.file) if report.file else root, []).append(report)
        read = {Path(file) for file in answer["files"]}
        changed = self._read.get(root, set()) ^ read
        self._read[root] = read
        self._store(root, reports_of_files, versions, changed)
        self._check_parts(root, changed)

    def _forget(self, root: DocumentKey, versions: Mapping[DocumentKey, int | None]) -> None:
        """Remove the reports of a document that does not exist, or is checked as a part of a project."""
        read = self._read.pop(root, set())
        self._store(root, {}, versions, read)
        del self._found[root]
        self._check_parts(root, read)

    def _check_parts(self, root: DocumentKey, files: set[Path]) -> None:
        """Check files that *root* includes now and did not include before, or the reverse.

        The files of a project of Groot are checked with the project, and every other file alone.
        """
        if isinstance(root, Path) and root.suffix == PROJECT_SUFFIX:
            self._pending |= dict.fromkeys(sorted(files.intersection(self._project.files) - {root}))

    def _store(
        self,
        root: DocumentKey,
        reports_of_files: Mapping[DocumentKey, list[Report]],
        versions: Mapping[DocumentKey, int | None],
        changed: set[Path],
    ) -> None:
        """Publish the reports of every file that had or has reports by the check of *root*.

        Args:
            root: The checked document.
            reports_of_files: The reports of each file.
            versions: The version of each open document.
            changed: The files that *root* includes now and did not include before, or the reverse.
        """
        before = self._found.get(root, {})
        self._found[root] = {
            file: (versions.get(file), reports) for file, reports in reports_of_files.items()
        }
        for file in dict.fromkeys([*reports_of_files, *before, *sorted(changed & self._found.keys())]):
            version = versions.get(file)
            merged = merge(self._reports_about(file, version))
            self._project.set_reports(file, version, merged)
            self._publish(file, version, merged)

    def _reports_about(self, file: DocumentKey, version: int | None) -> Iterator[list[Report]]:
        """Yield the reports of each check about one version of a file.

        Reports about an older text have wrong places. They come again when their root is checked.
        """
        is_included = any(file in read for root, read in self._read.items() if root != file)
        for root, results in self._found.items():
            checked, reports = results.get(file, (None, []))
            if checked == version and root == file and is_included:
                # The file alone does not show which keys its callers connect, and in which format it is read
                # if it states none. The checks of its callers do.
                document = self._project.file(file) if isinstance(file, Path) else None
                if document is None or stated_format(document.scan) is not None:
                    yield [report for report in reports if not report.outer_key]
            elif checked == version:
                yield reports

    def _show_once(self, message: str) -> None:
        """Show a message, unless it was shown before: while a user types, the same failure occurs again."""
        if message not in self._shown:
            self._shown.add(message)
            self._show(message)

    def _publish_problems(self, problems: Iterable[tuple[str, str, int]]) -> None:
        """Publish the problems of libraries at their files and lines, and show those without a place."""
        reports: dict[Path, list[Report]] = {}
        for message, file, line in problems:
            if file:
                report = Report(file, line - 1, 0, _LINE_END, "", True, message)
                reports.setdefault(Path(file), []).append(report)
            else:
                self._show_once(message)
        for path in dict.fromkeys([*reports, *self._library_problems]):
            self._publish(path, None, reports.get(path, []))
        self._library_problems = reports

    # --- the worker

    async def _loaded_worker(self) -> WorkerProcess:
        """Return the worker process. It is started if there is none, or if a source file changed."""
        if self._worker is not None and self._sources != _stamps(self._sources):
            self.reload()
        if self._worker is not None:
            return self._worker
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
            self._show_once("Python leaves are unknown: they are not imported without the setting 'trusted'.")
        self._worker = worker = await WorkerProcess.start()
        self._sent = {}
        try:
            answer = await worker.ask(settings._asdict(), LOAD_LIMIT_S)
        except WorkerError as error:
            if self._worker is not worker:
                return await self._loaded_worker()  # the settings changed meanwhile
            self._worker = None
            if not settings.trusted:
                raise
            self._show_once(f"The import of the node libraries {error}. Nodes of the last import are kept.")
            self._distrusted = True
            return await self._loaded_worker()
        models = [NodeModel.from_data(data) for data in answer["models"]]
        project.set_models(models, answer["enums"])
        self._last = answer
        earlier = self._sources if self._distrusted else ()
        self._sources = _stamps({*map(Path, answer["sources"]), *earlier})
        self._publish_problems(answer["problems"])
        self._refresh()
        return worker


def _stamps(files: Iterable[Path]) -> dict[Path, FileStamp | None]:
    return {file: file_stamp(file) for file in files}
