"""The report of a run: the heading of its summary, and the object of ``--json``."""

from collections.abc import Mapping
from typing import Final

from rich.text import Text

from btcore.cli import terminal
from btcore.cli.tick_loop import EndReason
from btcore.errors import NodeExecutionError
from btcore.status import Status
from btcore.tree.tree import Tree

END_REASON_TEXT: Final[dict[EndReason, str]] = {
    "done": "",
    "saved": "",
    "duration": ", by --duration",
    "interrupted": ", interrupted",
}
"""The end of a heading, by the reason why the run ended."""


class RunReport:
    """The report of the run *name*.

    Attributes:
        status: The status after the last tick.
        error: The exception that a leaf raised, or None.
        elapsed: The duration of the whole run in s of the tree's clock.
        wall: The duration of the whole run in s of real time.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.status = Status.IDLE
        self.error: NodeExecutionError | None = None
        self.elapsed = 0.0
        self.wall = 0.0

    @property
    def factor(self) -> float:
        """The speed of the run as a multiple of real time."""
        return self.elapsed / self.wall if self.wall > 0 else 0.0

    def heading(self, tree: Tree, ending: EndReason) -> Text:
        """Return a line with the result, the time, the number of ticks, and what ended the run.

        Args:
            tree: The last tree of the run.
            ending: The reason why the run ended.
        """
        raised = Text("✘ RAISED", style="bold red")
        result = terminal.format_status(self.status) if self.error is None else raised
        ticks = "1 tick" if tree.ticks == 1 else f"{tree.ticks} ticks"
        took = f"{self.elapsed:.1f} s, {ticks}, ×{self.factor:.1f} real time{END_REASON_TEXT[ending]}"
        return Text.assemble(result, "  ", (self.name, "bold"), "  ", took)

    def results(self, tree: Tree) -> dict[str, dict[str, object]]:
        """Return the tick counts of each node by full path; equal paths are distinguished by ``#<uid>``."""
        return {
            key: {
                "id": node.id,
                "ticks": tally.ticks,
                "success": tally.success,
                "failure": tally.failure,
                "skipped": tally.skipped,
                "halted": tally.halted,
            }
            for key, node in tree.nodes_by_path().items()
            for tally in (node.count_ticks(),)
        }

    def report(self, tree: Tree, figures: Mapping[str, object]) -> dict[str, object]:
        """Return the object of ``--json``.

        Args:
            tree: The last tree of the run.
            figures: The reports of the extensions, which are added to the object.
        """
        report: dict[str, object] = {
            "status": self.status.name,
            "ticks": tree.ticks,
            "time_s": self.elapsed,
            "real_time_factor": round(self.factor, 3),
            "nodes": self.results(tree),
            **figures,
        }
        if self.error is not None:
            report["error"] = {
                "node": self.error.path,
                "id": self.error.node_id,
                "while": self.error.doing,
                "exception": type(self.error.cause).__name__,
                "message": str(self.error.cause),
            }
        return report
