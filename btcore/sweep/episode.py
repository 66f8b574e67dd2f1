"""One episode, played in a worker: what ``btcore run`` does, in a process that plays one after the other."""

import io
import json
import threading
import time
from collections.abc import Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from functools import cache
from typing import Any, Final

import click

from btcore.cli.exit_codes import ExitCode
from btcore.cli.node_libraries import NodeLibraries, load_libraries
from btcore.cli.run import create_session, run
from btcore.errors import BtcoreError
from btcore.sweep.failure_cause import FailureCause

_MOST_SAID: Final = 20  # warnings that one episode hands on

_ONE_AT_A_TIME: Final = threading.Lock()  # all threads have one standard output, and one folder

Result = dict[str, Any]


def run_episode(command: Sequence[str], folder: str) -> Result:
    """Run ``btcore run`` with the words of *command* in *folder*, and tell how that went.

    The result is ``code``, the exit code; ``report``, the object of ``--json``, None where no run was had;
    ``blamed``, the node that made the tree fail or that raised; ``said``, what was warned of; ``fault``, why
    no run was had (code 2: a mistake of the user's, 70: of the program's); ``wall_s``.
    """
    said = io.StringIO()
    result: Result
    # Whoever prints in a worker prints into nobody's terminal.
    with _ONE_AT_A_TIME, redirect_stdout(io.StringIO()), redirect_stderr(said):
        began = time.perf_counter()
        try:
            with chdir(folder):
                result = _played(command)
        except FileNotFoundError as fault:
            if fault.filename != folder:
                result = _bug(fault)
            else:
                text = f"a worker's machine has no folder '{folder}', where the sweep's files are"
                result = _refused(ExitCode.USER_ERROR, text)
        except click.ClickException as mistake:
            result = _refused(ExitCode.USER_ERROR, mistake.format_message())
        except BtcoreError as fault:
            notes = [f"note: {note}" for note in getattr(fault, "__notes__", ())]
            result = _refused(ExitCode.USER_ERROR, "\n".join([str(fault), *notes]))
        except (Exception, SystemExit) as bug:
            result = _bug(bug)
    result["said"] = _warnings(said.getvalue())
    result["wall_s"] = round(time.perf_counter() - began, 4)
    return result


def _played(command: Sequence[str]) -> Result:
    with run.make_context("run", list(command)) as context:
        blame = FailureCause()
        made = create_session(context, context.params, [blame], _installed())
        done = made.execute()
        report = json.loads(json.dumps(made.outcome.report(made.tree, done.figures)))
        error = made.outcome.error
        blamed = error.path if error is not None else blame.node_path
        return {"code": done.code, "report": report, "blamed": blamed, "fault": None}


@cache
def _installed() -> NodeLibraries:
    """The nodes of the installed libraries, found once in a process."""
    return load_libraries(())


def _bug(fault: BaseException) -> Result:
    return _refused(ExitCode.INTERNAL_ERROR, f"{type(fault).__name__}: {fault}")


def _refused(code: ExitCode, fault: str) -> Result:
    return {"code": code, "report": None, "blamed": None, "fault": fault}


def _warnings(text: str) -> list[str]:
    """The sentences of *text* that are warnings, each once."""
    found = [line.removeprefix("warning: ") for line in text.splitlines() if line.startswith("warning: ")]
    return list(dict.fromkeys(found))[:_MOST_SAID]
