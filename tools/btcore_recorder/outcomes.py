"""A recording as outcomes of leaves, with which mock leaves and the model leaves of proofs repeat it."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import NS_PER_S
from btcore.engine.node import TreeNode
from btcore.engine.recorded_events import ChildTicked, ExternalHaltBegan, ExternalHaltEnded, TimeRead, Written
from btcore.registry.outcome_grammar import LETTERS, Outcome
from btcore.status import IDLE, RUNNING
from btcore.tree.tree import Tree
from btcore_recorder.inputs import Input, Result, Step
from btcore_recorder.replay import Replay
from btcore_recorder.values import NotReplayable

_LETTER_OF: Final = {status: letter for letter, status in LETTERS.items()}

TickOutcomes = tuple[list[float], dict[str, str]]
"""The times (s) of a tick, one for each reading of the clock, and outcomes of leaves by name."""


def read_outcomes(file: Path) -> tuple[list[TickOutcomes], dict[str, str]]:
    """Return what the leaves of a recording do in each tick, and the entries of the main tree before.

    A leaf is named by its path if its name is not unique. A decorator that ticks its child has no outcome,
    but one that returns RUNNING instead. Values are texts; `?` is a value that could not be recorded.

    Raises:
        LogError: The file cannot be read, or the recording is invalid.
        TreeError: The recorded tree cannot be loaded.
    """
    replay = Replay(file)
    state = replay.recording.head.state
    main = state.scopes[0]
    values = {key: replay.decode(state.entries[index].value) for key, index in main.items()}
    entries = {key: _text(value) for key, value in values.items() if value is not None}
    names = _names(replay.tree)
    ticks = [
        (_times(step, replay.recording.head.time), _outcomes(step.inputs, replay, names))
        for step in replay.steps
        if step.tick
    ]
    return ticks, entries


def _names(tree: Tree) -> list[str]:
    """Return the names of the nodes, and their paths if other nodes have the same name."""
    counts = Counter(node.name for node in tree.nodes)
    paths = tree.nodes_by_path()
    return [node.name if counts[node.name] == 1 else path for path, node in paths.items()]


def _times(step: Step, start: int) -> list[float]:
    times = [step.time]
    for event in step.inputs:
        if isinstance(event, TimeRead):
            times += [*[times[-1]] * event.repeats, event.time]
    return [(time - start) / NS_PER_S for time in times]


def _outcomes(inputs: Iterable[Input], replay: Replay, names: list[str]) -> dict[str, str]:
    """Return the outcomes of the leaves in a tick, by name."""
    found: dict[str, str] = {}
    written: dict[tuple[int, str], str] = {}
    ticked: set[int] = set()
    halts = 0
    for event in inputs:
        match event:
            case ExternalHaltBegan():
                halts += 1
            case ExternalHaltEnded():
                halts -= 1
                written.clear()
            case ChildTicked(uid):
                ticked.add(uid)
                written.clear()
            case Written(scope, key, value, _):
                written[scope, key] = _text(replay.decode(value))
            case Result(uid, status) if status is not IDLE and not halts:
                node, name = replay.tree.nodes[uid - 1], names[uid - 1]
                passed = ticked & {child.config.uid for child in node.children}
                if not passed and (not node.children or status is RUNNING):
                    outputs = tuple(
                        (_port(node, replay.boards[scope], key), text)
                        for (scope, key), text in written.items()
                    )
                    found[name] = found.get(name, "") + str(Outcome(_LETTER_OF[status], outputs))
                ticked -= passed
                written.clear()
    return found


def _port(node: TreeNode, board: Blackboard, key: str) -> str:
    """Return the name of the output port that writes *key* of *board*; *key* if there is none."""
    outputs = node.config.outputs.items()
    return next((name for name, port in outputs if port.blackboard is board and port.key == key), key)


def _text(value: object) -> str:
    if isinstance(value, NotReplayable):
        return value.text
    return str(value).lower() if isinstance(value, bool) else str(value)
