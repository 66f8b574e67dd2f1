"""The report of a run: the results that its providers add, and their warnings."""

import json
import sys
import warnings
from collections.abc import Sequence

from btcore.errors import BtcoreError
from btcore.escaping import escape_controls
from btcore.runs.run_end import EndReason, RunEnd
from btcore.runs.settings import Settings


class RunPrinter:
    """Prints the messages of a program's run; commands override the methods."""

    def print_warning(self, message: str) -> None:
        """Print a warning of a provider."""
        print(f"warning: {escape_controls(message)}", file=sys.stderr)

    def print_unused(self, settings_class: type[Settings], reason: str) -> None:
        """Warn that the settings of a class have no effect: no provider uses them, for *reason*."""
        warnings.warn(f"{settings_class.__name__} have no effect: {reason}", stacklevel=4)

    def print_errors(self, errors: Sequence[BtcoreError]) -> bool:
        """Print what the providers raised when they were closed; return False to let the run raise it."""
        return False


class Report(dict[str, object]):
    """The results of a run for the summary and for `--json`, by heading. A provider may have it as parameter.

    Args:
        run_end: The end of the run.
        printer: Prints the warnings.
    """

    def __init__(self, run_end: RunEnd | None = None, printer: RunPrinter | None = None) -> None:
        super().__init__()
        self._run_end = run_end or RunEnd()
        self._printer = printer or RunPrinter()

    @property
    def end_reason(self) -> EndReason | None:
        """Why the run ended; None before its end."""
        return self._run_end.reason

    def warn(self, message: str) -> None:
        """Print a warning."""
        self._printer.print_warning(message)

    def __setitem__(self, heading: str, values: object) -> None:
        """Set the results under *heading*.

        Raises:
            TypeError: The results are not JSON data.
        """
        json.dumps(values)
        super().__setitem__(heading, values)

    def add(self, heading: str, values: dict[str, object]) -> None:
        """Add results under *heading*, besides those that are there already.

        Args:
            heading: The heading in the summary, and the key in `--json`.
            values: The results, as JSON data.

        Raises:
            TypeError: The results are not JSON data.
        """
        before = self.get(heading)
        self[heading] = {**before, **values} if isinstance(before, dict) else values
