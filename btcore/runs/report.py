"""The report of a run: the results that its providers add, and their warnings."""

import json
import sys
from collections.abc import Callable

from btcore.escaping import escape_controls
from btcore.runs.run_end import EndReason


class Report(dict[str, object]):
    """The results of a run for the summary and for `--json`, by heading. A provider may have it as parameter.

    Args:
        find_end_reason: Returns why the run ended, or None before its end.

    Attributes:
        print_warning: Prints the warnings, by default on stderr.
    """

    def __init__(self, find_end_reason: Callable[[], EndReason | None] = lambda: None) -> None:
        super().__init__()
        self._find_end_reason = find_end_reason
        self.print_warning = _print_warning

    @property
    def end_reason(self) -> EndReason | None:
        """Why the run ended; None before its end."""
        return self._find_end_reason()

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
