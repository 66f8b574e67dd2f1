"""The report of a run: the results that its providers add, and their warnings."""

import json
import sys

from btcore.escaping import escape_controls
from btcore.runs.run_end import EndReason, RunEnd


class Report(dict[str, object]):
    """The results of a run for the summary and for `--json`, by heading. A provider may have it as parameter.

    Args:
        run_end: The end of the run.

    Attributes:
        print_warning: Prints the warnings, by default on stderr.
    """

    def __init__(self, run_end: RunEnd | None = None) -> None:
        super().__init__()
        self._run_end = run_end or RunEnd()
        self.print_warning = _print_warning

    @property
    def end_reason(self) -> EndReason | None:
        """Why the run ended; None before its end."""
        return self._run_end.reason

    def warn(self, message: str) -> None:
        """Print a warning."""
        self.print_warning(message)

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


def _print_warning(message: str) -> None:
    print(f"warning: {escape_controls(message)}", file=sys.stderr)
