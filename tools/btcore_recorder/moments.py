"""The moments of a recording: the tree after each step, and what its leaves read and wrote in that step."""

import math
import os
import time
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Final

from btcore.blackboard.blackboard import Blackboard
from btcore.engine.node import TreeNode
from btcore.engine.recorded_events import MessageLogged
from btcore.errors import BtcoreError
from btcore.logs.moments import Explanation, LeafTick, Moment, Values
from btcore.status import IDLE, RUNNING, Status
from btcore.xml.plan.key_uses import READING, WRITING, find_name_uses
from btcore_recorder.files import TEXT, describe_reconstruction, recording_text
from btcore_recorder.inputs import Input, RunRecording, Step, is_external
from btcore_recorder.replay import STATE_INTERVAL, Replay
from btcore_recorder.tick_trace import scripts_of
from btcore_recorder.values import MAX_SHOWN, value_text

MAX_ENTRIES: Final = 1_000
MAX_TESTED_TICKS: Final = 2_000
"""Maximum number of steps of a run for which a test is written."""
MAX_LEAVES: Final = 200
"""Maximum number of leaves that are described in a moment."""
_MAX_MESSAGES: Final = 30
_MAX_OBSERVATIONS: Final = 10_000
"""Maximum number of ticks of leaves in a step that are observed: a tick may repeat a leaf very often."""


class Moments(Replay):
    """The moments of a recording, in any order.

    It satisfies the protocol of the entry point group `btcore.recordings`, which the studio declares.

    Args:
        recording: The recording, or the path of its file.

    Raises:
        LogError: The file cannot be read, or the recording is invalid.
        TreeError: The recorded tree cannot be loaded.

    Examples:
        >>> import btcore
        >>> from btcore_recorder import record
        >>> from btcore_recorder.moments import Moments
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Sequence(b.Script(code="tries := 1"), b.ScriptCondition(code="tries == 2")))
        >>> with record(tree, "run.btrec.txt"):
        ...     _ = tree.tick_exactly_once()
        >>> moment = Moments("run.btrec.txt").at(1)
        >>> moment.tick, moment.root.name, moment.entries
        (1, 'FAILURE', (('', 'tries', '1'),))
    """

    def __init__(self, recording: RunRecording | str | os.PathLike[str]) -> None:
        super().__init__(recording)
        self._reached = 0
        self._is_observing = False
        self._leaf_ticks: dict[int, LeafTick] = {}  # the last tick of each leaf in the step
        self._messages: list[str] = []
        self._tick_count = 0  # of leaves in the step
        for node in self.tree.nodes:
            if not node.children and not is_external(type(node)):
                node.set_post_tick_function(self._post_tick)

    @property
    def count(self) -> int:
        """The number of steps: the last moment."""
        return len(self.steps)

    @property
    def roots(self) -> Sequence[Status]:
        """The recorded result of each step; IDLE for a halt."""
        return [step.status for step in self.steps]

    @property
    def warnings(self) -> Sequence[str]:
        """What the recording lacks, as sentences."""
        recording = self.recording
        return [*filter(None, (recording.damage, describe_reconstruction(recording.head)))]

    def at(self, position: int, limit: float = math.inf) -> Moment:
        """Return the moment after *position* steps.

        Args:
            position: The number of steps; a number that is out of range is limited.
            limit: The time (s) after which the moment that was reached is returned instead. It counts only
                while the replay reaches this part of the recording for the first time.
        """
        position = max(0, min(position, self.count))
        deadline = time.monotonic() + limit
        while self._reached < position - 1 and self.seek(min(position - 1, self._reached + STATE_INTERVAL)):
            self._reached = self.position
            if time.monotonic() > deadline:
                break
        else:
            self.seek(max(0, position - 1))
        self._is_observing = True
        if position:
            self.step()
        else:
            self._leaf_ticks.clear()
        self._is_observing = False
        self._reached = max(self._reached, self.position)
        return self.current()

    def why(self, uid: int, position: int, limit_s: float = math.inf) -> Explanation:
        """Explain what a node did in the last tick of the first *position* steps.

        Args:
            uid: The number of the node.
            position: The number of steps.
            limit_s: As in `btcore_recorder.Explainer`.

        Raises:
            BtcoreError: There is no such tick, or the replay differs from the recording.
        """
        from btcore_recorder.why import Explainer  # most users of moments do not need it

        recording = self.recording
        step = recording.tick_at(min(position, self.count) - 1) if position > 0 else None
        if step is None:
            raise BtcoreError("there is no tick yet that could be explained")
        uids = {path: node.config.uid for path, node in self.tree.nodes_by_path().items()}
        answer = Explainer(recording, limit_s).why(list(uids)[uid - 1], step.tick)
        links = ((uids.get(link.node, 0), link.tick, link.because, link.tried) for link in answer.chain)
        return Explanation(answer.question, answer.answer, tuple(links))

    def recording_text(self) -> str:
        """Return the recording so far in the text form."""
        return recording_text(self.recording)

    def test_text(self, name: str, tree: str) -> str:
        """Return the source code of a test that runs the tree again, with the answers of this run.

        Args:
            name: The name of the recording beside the test, without its extension.
            tree: The name of the file of the tree beside the test.

        Raises:
            BtcoreError: The run has no tick yet, or is too long.
        """
        # Most users of moments do not need it.
        from btcore_recorder.saved_tests import source_of_test
        from btcore_recorder.what_if import run_changed

        recording = self.recording
        if not recording.steps:
            raise BtcoreError("the run has no tick yet, so there is nothing to test")
        if self.count > MAX_TESTED_TICKS:
            raise BtcoreError(f"a test has at most {MAX_TESTED_TICKS:,} ticks: this run has {self.count:,}")
        test, file = Path(f"test_{name}.py"), Path(f"{name}{TEXT}")
        return source_of_test(recording, run_changed(recording), test, file, Path(tree), {}, "btcore studio")

    def current(self) -> Moment:
        """Return the moment of the replay."""
        tree, position = self.tree, self.position
        tick = self.steps[position - 1].tick if position else 0
        return Moment(
            position,
            tick,
            self.recording.time_at(position - 1),
            tree.status,
            tuple(node._status for node in tree.nodes),
            tuple(_result(node) for node in tree.nodes),
            tuple(
                (part.path, key, value_text(entry.value))
                for part in tree.subtrees
                for key, entry in islice(sorted(part.blackboard.local_entries().items()), MAX_ENTRIES)
            )[:MAX_ENTRIES],
            tuple(self._leaf_ticks.values())[:MAX_LEAVES],
            "" if self.difference is None else str(self.difference),
        )

    # --- observing leaves

    def run_step(self, step: Step) -> Status:
        """Run a step; see `RecordedTree.run_step`."""
        self._leaf_ticks.clear()
        self._tick_count = 0
        return super().run_step(step)

    def _tick_external(self, node: TreeNode) -> Status:
        if node.children or not self._count_observation():
            return super()._tick_external(node)
        before = input_values(node)
        self._messages.clear()
        numbers = {name: _entry_number(node, output.key) for name, output in node.config.outputs.items()}
        try:
            status = super()._tick_external(node)
        except Exception as error:
            self._add(node, IDLE, before, self._logged(), str(error)[:MAX_SHOWN])
            raise
        written = {
            name: text
            for name, text in _output_values(node).items()
            if _entry_number(node, node.config.outputs[name].key) != numbers[name]
        }
        self._add(node, status, before, {**written, **self._logged()})
        return status

    def _apply(self, event: Input, now: str) -> None:
        if isinstance(event, MessageLogged) and len(self._messages) < _MAX_MESSAGES:
            self._messages.append(event.text)
        super()._apply(event, now)

    def _logged(self) -> Values:
        return {"logged": "; ".join(self._messages)[:MAX_SHOWN]} if self._messages else {}

    def _post_tick(self, node: TreeNode, status: Status) -> Status:
        if not node.children and not is_external(type(node)) and self._count_observation():
            read, written = _script_values(node)
            self._add(node, status, {**input_values(node), **read}, {**_output_values(node), **written})
        return super()._post_tick(node, status)

    def _count_observation(self) -> bool:
        """Count an observation; return whether it has to be made."""
        self._tick_count += 1
        return self._is_observing and self._tick_count <= _MAX_OBSERVATIONS

    def _add(self, node: TreeNode, status: Status, inputs: Values, outputs: Values, error: str = "") -> None:
        uid = node.config.uid
        self._leaf_ticks.pop(uid, None)  # the order is that of the last ticks
        self._leaf_ticks[uid] = LeafTick(uid, node.path, status, inputs, outputs, error)


def _result(node: TreeNode) -> Status:
    before = node._status_before_reset
    return before if node._status is IDLE and before is not RUNNING else IDLE


def input_values(node: TreeNode) -> Values:
    """Return the values of the inputs of a node as texts."""
    return {
        name: port.text[:MAX_SHOWN] if port.key is None else _entry_text(port.blackboard, port.key)
        for name, port in node.config.inputs.items()
    }


def _output_values(node: TreeNode) -> Values:
    return {
        name: "–" if port.key is None else _entry_text(port.blackboard, port.key)
        for name, port in node.config.outputs.items()
    }


def _script_values(node: TreeNode) -> tuple[Values, Values]:
    """Return the values of the entries that the scripts in the ports of *node* read, and write."""
    config = node.config
    scripts = [text for by, text in scripts_of(node) if by not in config.conditions]
    uses = [use for text in scripts for use in find_name_uses(text, config.enums)]
    written = {use.name for use in uses if use.access in WRITING}
    read = {use.name for use in uses if use.access in READING} - written
    board = node.blackboard
    values = [{name: _entry_text(board, name) for name in sorted(names)} for names in (read, written)]
    return values[0], values[1]


def _entry_text(board: Blackboard, key: str) -> str:
    entry = board.find(key)
    return "–" if entry is None else value_text(entry.value)


def _entry_number(node: TreeNode, key: str | None) -> int:
    entry = None if key is None else node.blackboard.find(key)
    return 0 if entry is None else entry.sequence_id
