"""Running an episode in a worker process, which runs many episodes one after the other.

An episode does the same as `btcore run`. In addition, it finds the node that made the tree fail.
"""

import io
import json
import threading
import time
from collections.abc import Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any, Final

import click

from btcore.cli import terminal
from btcore.cli.commands.run import parse_run
from btcore.cli.run_summary import results_as_data
from btcore.engine.observers import Observer
from btcore.errors import BtcoreError
from btcore.exit_codes import ExitCode
from btcore.status import Status, Transition
from btcore.tree.tree import Tree

_MAX_WARNINGS: Final = 20  # that an episode returns

# An episode redirects stdout and changes the working directory, which all threads of a process share.
_LOCK: Final = threading.Lock()

Result = dict[str, Any]


def run_episode(
    command: Sequence[str], folder: str, recording: str = "", record_on: str = "failure"
) -> Result:
    """Run an episode.

    Args:
        command: The arguments of `btcore run`.
        folder: The working directory.
        recording: The file to which the run is recorded, with its absolute path; "" = it is not recorded.
        record_on: The value of the option `--record-on`.

    Returns:
        A dict. `code`: the exit code; `report`: the object that `--json` prints, or None if the run
        could not start; `failed_at`: the path of the node that made the tree fail or that raised an
        exception, or None; `warnings`: the first lines of the first warnings; `fault`: why the run could not
        start or continue, or None (code 2: an error of the user, 70: an internal error); `began`: True if
        the run could not continue, otherwise missing; `wall_s`: the duration (s of real time).
    """
    result: Result
    if recording:
        with suppress(OSError):  # another machine may be unable to write there
            Path(recording).parent.mkdir(exist_ok=True)
            command = [*command, "--record", recording, "--record-on", record_on]
    # A worker has no terminal: its output is dropped, and warnings are returned.
    output = io.StringIO()
    with (
        _LOCK,
        terminal.collect_warnings() as warnings,
        redirect_stdout(output),
        redirect_stderr(output),
    ):
        began = time.perf_counter()
        try:
            with chdir(folder):
                result = _run(command)
        except FileNotFoundError as error:
            if error.filename != folder:
                result = _internal_error(error)
            else:
                message = (
                    f"the machine of a worker has no folder '{folder}', which contains the sweep's files"
                )
                result = _fault_result(ExitCode.USER_ERROR, message)
        except click.ClickException as error:
            result = _fault_result(ExitCode.USER_ERROR, error.format_message())
        except BtcoreError as error:
            notes = [f"note: {note}" for note in getattr(error, "__notes__", ())]
            result = _fault_result(ExitCode.USER_ERROR, "\n".join([str(error), *notes]))
        except (Exception, SystemExit) as error:
            result = _internal_error(error)
    # The sweep prints where the recordings are.
    others = [warning for warning in warnings if not (recording and recording in warning)]
    lines = [warning.partition("\n")[0] for warning in others]
    result["warnings"] = list(dict.fromkeys(lines))[:_MAX_WARNINGS]
    result["wall_s"] = round(time.perf_counter() - began, 4)
    return result


def _run(command: Sequence[str]) -> Result:
    with parse_run(command) as session:
        finder = FailureCauseFinder()
        has_begun = False

        def begin(tree: Tree) -> None:
            nonlocal has_begun
            has_begun = True
            tree.subscribe(finder)

        try:
            session.run_to_end(begin)
        except BtcoreError as reason:
            if not has_begun:
                raise
            return _fault_result(ExitCode.USER_ERROR, str(reason), has_begun=True)
        # Convert to JSON and back, as for --json: a report that is not JSON data raises here, in the worker.
        report = json.loads(json.dumps(results_as_data(session.run)))
        finished = session.run
        if finished.exit_code == ExitCode.USER_ERROR:  # of a provider that was closed
            fault = "; ".join(map(str, finished.providers.errors))
            return _fault_result(ExitCode.USER_ERROR, fault, has_begun=True)
        failed_at = finished.error.path if finished.error is not None else finder.find(finished.tree)
        return {"code": finished.exit_code, "report": report, "failed_at": failed_at, "fault": None}


def _internal_error(error: BaseException) -> Result:
    return _fault_result(ExitCode.INTERNAL_ERROR, f"{type(error).__name__}: {error}")


def _fault_result(code: ExitCode, message: str, has_begun: bool = False) -> Result:
    """Return the result of an episode that could not start or, if it *has_begun*, not continue."""
    result: Result = {"code": code, "report": None, "failed_at": None, "fault": message}
    return {**result, "began": True} if has_begun else result


class FailureCauseFinder(Observer):
    """An observer that finds the node that made the tree fail in the last tick."""

    def __init__(self) -> None:
        self._tick = 0
        self._failed: list[int] = []

    def transition(self, change: Transition) -> None:
        """Record the node if *change* is a transition to FAILURE."""
        if change.status is Status.FAILURE:
            if change.tick != self._tick:
                self._tick = change.tick
                self._failed.clear()
            self._failed.append(change.uid)

    def find(self, tree: Tree) -> str | None:
        """Return the path of the node, or None if the root did not fail in the last tick.

        The search starts at the root and descends to the child that failed in that tick; if several children
        failed, to the child that failed last.
        """
        order = {uid: number for number, uid in enumerate(self._failed)}
        if tree.ticks != self._tick or tree.root.config.uid not in order:
            return None
        paths = {node.config.uid: path for path, node in tree.nodes_by_path().items()}
        node = tree.root
        while failed := [child for child in node.children if child.config.uid in order]:
            node = max(failed, key=lambda child: order[child.config.uid])
        return paths[node.config.uid]
