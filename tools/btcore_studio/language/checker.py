"""The background checks of a project: the order of the checks, and their results."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterator, Mapping
from pathlib import Path
from typing import Final

from btcore_studio.language.diagnostics import Report, merge, report_from_data
from btcore_studio.language.library_worker import (
    LibraryWorker,
    Publish,
    StartWorker,
    WorkerError,
    WorkerProcess,
)
from btcore_studio.language.project import (
    PROJECT_SUFFIX,
    SUFFIXES,
    DocumentKey,
    Project,
    SourceDocument,
    has_trees,
)
from btcore_studio.language.symbols import stated_format

PAUSE_S: Final = 0.1
"""Time between a change and the check (s). Further changes in this time need no check of their own."""

_log: Final = logging.getLogger(__name__)


class CheckResults:
    """The reports of the checked documents, and the files that each document includes.

    Args:
        publish: Called with the reports of each file that change.
    """

    def __init__(self, project: Project, publish: Publish) -> None:
        self._project = project
        self._publish = publish
        # The reports of each root about each file, and the version of the file that was checked.
        self._found: dict[DocumentKey, dict[DocumentKey, tuple[int | None, list[Report]]]] = {}
        self._read: dict[DocumentKey, set[Path]] = {}

    def __contains__(self, root: DocumentKey) -> bool:
        return root in self._found

    def roots_with(self, path: Path | None) -> list[DocumentKey]:
        """Return the checked documents that include a file."""
        return [root for root, read in self._read.items() if path in read]

    def store(
        self,
        root: DocumentKey,
        reports_of_files: Mapping[DocumentKey, list[Report]],
        versions: Mapping[DocumentKey, int | None],
        read: set[Path],
    ) -> set[Path]:
        """Publish the reports of every file that had or has reports by the check of *root*.

        Args:
            root: The checked document.
            reports_of_files: The reports of each file.
            versions: The version of each open document.
            read: The files that *root* includes.

        Returns:
            The files that *root* includes now and did not include before, or the reverse.
        """
        changed = self._read.get(root, set()) ^ read
        self._read[root] = read
        before = self._found.get(root, {})
        self._found[root] = {
            file: (versions.get(file), reports) for file, reports in reports_of_files.items()
        }
        for file in dict.fromkeys([*reports_of_files, *before, *sorted(changed & self._found.keys())]):
            version = versions.get(file)
            merged = merge(self._reports_about(file, version))
            self._project.set_reports(file, version, merged)
            self._publish(file, version, merged)
        return changed

    def forget(self, root: DocumentKey, versions: Mapping[DocumentKey, int | None]) -> set[Path]:
        """Remove the reports of a document. Return the files that it included."""
        changed = self.store(root, {}, versions, set())
        del self._found[root], self._read[root]
        return changed

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


class Checker:
    """Checks the documents of a project in a worker process: the changed document first, then the others.

    Args:
        publish: Called with a file and its reports, or with a URI for a document without a file.
        show: Called with a message for the user.
        refresh: Called when the available nodes changed.
        start_worker: Starts the worker that checks; default a process.
    """

    def __init__(
        self,
        project: Project,
        publish: Publish,
        show: Callable[[str], None],
        refresh: Callable[[], None],
        start_worker: StartWorker = WorkerProcess.start,
    ) -> None:
        self._project = project
        self._show = show
        self._shown: set[str] = set()
        self._results = CheckResults(project, publish)
        self._worker = LibraryWorker(project, publish, self._show_once, refresh, start_worker)
        self._pending: dict[DocumentKey, None] = {}
        self._wake = asyncio.Event()
        self._task: asyncio.Task[None] | None = None

    # --- what to check

    def changed(self, document: SourceDocument) -> None:
        """Check *document* soon, and then the documents that include it."""
        first = self._roots_of(document)
        others = self._results.roots_with(document.path)
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
        if path in self._worker.sources:
            self.reload()
        roots = self._results.roots_with(path)
        # Other files are Python code, or XML of other programs.
        if path in self._results or (path.suffix in SUFFIXES and has_trees(path)):
            roots = [*self._project.roots_of(path), *roots]
        self._pending |= dict.fromkeys(roots)
        self._wake.set()

    def reload(self) -> None:
        """Load the node libraries again, and check all documents."""
        self._worker.reset()
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

    async def _run(self) -> None:
        try:
            await self._check_pending()
        finally:
            process = self._worker.stop()
            if process is not None:
                await process.wait()

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
                    self._worker.stop()
                    self._show_once(f"{root} cannot be checked: the check {error}.")
                except Exception:
                    _log.exception("the check of %s failed", root)

    async def _check(self, root: DocumentKey) -> None:
        if self._worker.is_outdated:
            self.reload()
        await self._worker.load()
        project = self._project
        versions: dict[DocumentKey, int | None] = {
            document.key: document.version for document in project.open_documents
        }
        document = project.document(root) if isinstance(root, str) else None
        if isinstance(root, Path):
            exists = (root in project.unsaved or root.is_file()) and root in project.roots_of(root)
        else:
            exists = document is not None
        if not exists:
            # There is no such document, or it is checked as a part of a project.
            self._check_parts(root, self._results.forget(root, versions))
            return
        request = {"file": str(root)} if document is None else {"file": "", "text": document.text}
        answer = await self._worker.check(request)
        if answer is None:
            self._pending[root] = None
            return
        reports_of_files: dict[DocumentKey, list[Report]] = {root: []}
        for data in answer["reports"]:
            report = report_from_data(data)
            reports_of_files.setdefault(Path(report.file) if report.file else root, []).append(report)
        read = {Path(file) for file in answer["files"]}
        self._check_parts(root, self._results.store(root, reports_of_files, versions, read))

    def _check_parts(self, root: DocumentKey, files: set[Path]) -> None:
        """Check files that *root* includes now and did not include before, or the reverse.

        The files of a project of Groot are checked with the project, and every other file alone.
        """
        if isinstance(root, Path) and root.suffix == PROJECT_SUFFIX:
            self._pending |= dict.fromkeys(sorted(files.intersection(self._project.files) - {root}))

    def _show_once(self, message: str) -> None:
        """Show a message, unless it was shown before: while a user types, the same failure occurs again."""
        if message not in self._shown:
            self._shown.add(message)
            self._show(message)
