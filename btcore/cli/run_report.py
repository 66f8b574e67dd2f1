"""How a run went: as a line for people, and as the object of ``--json``."""

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
"""What a heading says of how a run ended."""


class RunReport:
    """What is known at the end of the run called *name*.

    *status* is the last tick's, *error* what a leaf raised; *elapsed* is in s of the tree's clock, *wall*
    in s of real time, both of the whole run.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.status = Status.IDLE
        self.error: NodeExecutionError | None = None
        self.elapsed = 0.0
        self.wall = 0.0

    @property
    def factor(self) -> float:
        """How many times faster than real time it was."""
        return self.elapsed / self.wall if self.wall > 0 else 0.0

    def heading(self, tree: Tree, ending: EndReason) -> Text:
        """One line: the result, the time, the ticks of the (last) *tree*, and what ended it."""
        raised = Text("✘ RAISED", style="bold red")
        result = terminal.format_status(self.status) if self.error is None else raised
        ticks = "1 tick" if tree.ticks == 1 else f"{tree.ticks} ticks"
        took = f"{self.elapsed:.1f} s, {ticks}, ×{self.factor:.1f} real time{END_REASON_TEXT[ending]}"
        return Text.assemble(result, "  ", (self.name, "bold"), "  ", took)

    def results(self, tree: Tree) -> dict[str, dict[str, object]]:
        """What each node did, by full path; where two paths are equal ``#<uid>`` tells them apart."""
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
        """The object of ``--json``; *figures* are what others add to it."""
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
