"""How a run ends: the events that end it, the reason, and the exit code."""

from collections.abc import Sequence
from typing import Literal

from btcore.errors import BtcoreError, NodeExecutionError, OutputError, ProviderError
from btcore.exit_codes import ExitCode, code_of_signal
from btcore.runs.tick_loop import LoopEnd
from btcore.status import Status

EndReason = Literal[LoopEnd, "raised", "program_error"]
"""Why a run ended: as its loop ended, because a leaf raised an exception, or because another exception left
the `with` block of the run ("interrupted", if it is a KeyboardInterrupt or SystemExit)."""


def join_errors(errors: Sequence[BtcoreError]) -> BtcoreError:
    """Return an `OutputError` if all errors are about incomplete outputs, otherwise another error."""
    if len(errors) == 1:
        return errors[0]
    text = "; ".join(map(str, errors))
    are_outputs = all(isinstance(error, OutputError) for error in errors)
    return OutputError(text) if are_outputs else ProviderError(text)


class RunEnd:
    """The events that end a run, the reason, and the exit code.

    Of several events, `reason` and `exit_code` each check the most important first.

    Attributes:
        error: The exception of a leaf, in a tick or when it was halted; None again if its tree was replaced.
        signal: The number of the signal that has ended the loop, or the waits of providers; 0 without one.
        loop_end: Why the loop has ended, unless it was by an exception.
    """

    def __init__(self) -> None:
        self.error: NodeExecutionError | None = None
        self.signal = 0
        self.loop_end: LoopEnd | None = None
        self._block_end: EndReason | None = None  # why the `with` block ended, unless a leaf has raised

    def note_exit(self, error: BaseException | None, signal: int) -> None:
        """Note the exception that has left the `with` block, and the number of the last *signal*, or 0.

        The signal counts only if the exception is KeyboardInterrupt or SystemExit.
        """
        self.loop_end = self.loop_end or "done"
        if isinstance(error, (KeyboardInterrupt, SystemExit)):
            self._block_end, self.signal = "interrupted", signal
        elif error is not None and error is not self.error:
            self._block_end = "program_error"

    @property
    def reason(self) -> EndReason | None:
        """Why the run ended; None before its end."""
        if self._block_end is not None:
            return self._block_end
        if self.error is not None:
            return "raised"
        return "interrupted" if self.signal else self.loop_end

    def exit_code(self, status: Status, closing_errors: Sequence[BtcoreError]) -> ExitCode:
        """Return the exit code of a process for the run, whose tree has a *status*."""
        if self.error is not None:
            return ExitCode.LEAF_ERROR
        if closing_errors:
            are_outputs = isinstance(join_errors(closing_errors), OutputError)
            return ExitCode.INCOMPLETE_OUTPUT if are_outputs else ExitCode.USER_ERROR
        if self.signal:
            return code_of_signal(self.signal)
        failed = self.reason == "done" and status is Status.FAILURE
        return ExitCode.FAILURE if failed else ExitCode.SUCCESS
