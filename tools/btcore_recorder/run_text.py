"""Recording a run in memory: the entry point of the group `btcore.recorded_runs`, for the studio.

There is neither a file nor a thread, so that it also works in a browser.
"""

from collections.abc import Callable
from typing import Any

from btcore.tree.tree import Tree
from btcore_recorder.lines import WrittenLine, head_lines
from btcore_recorder.recorder import RawStep, Recorder, RecorderOptions
from btcore_recorder.text_form import TextEncoder


def record_run(run: Callable[[Callable[[Tree], object]], object]) -> str:
    """Return the recording of a run, in the text form (`.btrec.txt`).

    Args:
        run: Runs a tree; it calls its argument with the tree before the first tick.

    Examples:
        >>> import btcore
        >>> from btcore_recorder.run_text import record_run
        >>> b = btcore.Builder()
        >>> tree = b.build(b.AlwaysSuccess())
        >>> def run(attach):
        ...     attach(tree)
        ...     tree.tick_once()
        >>> record_run(run).startswith("btrec")
        True
    """
    encoder = TextEncoder()
    recorders: list[Recorder] = []
    types: list[WrittenLine] = []

    def deliver(step: RawStep) -> None:
        lines = recorders[0].lines(step)  # may find types
        encoder.add([*types, *lines], recorders[0].head.wall_time_at(step.time))
        types.clear()

    def found(name: str, description: Any) -> None:
        types.append(["type", name, description])

    def attach(tree: Tree) -> None:
        recorder = Recorder(tree, deliver, found, RecorderOptions())
        encoder.add(head_lines(recorder.head), recorder.head.wall_time)
        recorders.append(recorder)

    try:
        run(attach)
    finally:
        for recorder in recorders:
            recorder.close()
    return (encoder.take() + encoder.take_end()).decode("utf-8", "surrogatepass")
