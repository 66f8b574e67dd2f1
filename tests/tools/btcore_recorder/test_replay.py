"""A replay does what the recorded run did: every transition, every entry, at every tick."""

import os
import re
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import btcore
from btcore import (
    Blackboard,
    BtcoreError,
    NodeExecutionError,
    Observer,
    ScriptError,
    SimClock,
    Status,
    SystemClock,
    Transition,
    Tree,
    compile_script,
)
from btcore.blackboard.format3 import Format3Blackboard
from btcore.testing import xml_documents
from btcore.testing.tree_generator import BUILTIN_MANIFESTS, SCRIPT_KEYS
from btcore.tree.hooks import Hook, HookMode, HookPosition
from btcore.tree.tree import scopes_of
from btcore_recorder import Replay, record
from btcore_recorder.files import encoder_for, read_recording, save_recording
from btcore_recorder.inputs import RunRecording
from btcore_recorder.lines import head_lines, read_lines, recording_lines
from btcore_recorder.recorder import Recorder, RecorderOptions
from btcore_recorder.text_form import TextEncoder, TextLines
from tests.conformance.recorded_cases import CallLog, conformance_registry, read_cases
from tests.tools.btcore_recorder.random_leaves import NODE_IDS, Spot, random_registry

NODES = random_registry()
TAGS = (*BUILTIN_MANIFESTS[4], *NODE_IDS)
SCRIPTS = ("a := N; b += 1", "x := 'text'", "y = 1; c := 2", "z := missing")
CASES = Path(__file__).parents[2] / "conformance/data"
RUNS = os.environ.get("BTCORE_RUNS")

Entries = list[dict[str, tuple[str, int, str]]]


class Run(Observer):
    """A recorded run, with what a replay must repeat.

    Attributes:
        transitions_of_run: The transitions, without their times; of a run that is not *observed*, those since
            `observe`, and the recording has only their checksum.
        entries: The entries after each step. Other threads may change *ignored* entries meanwhile.
    """

    def __init__(self, tree: Tree, ignored: str = "", observed: bool = True) -> None:
        self.tree = tree
        self.transitions_of_run: list[tuple[int, int, Status, Status]] = []
        self.entries: list[Entries] = []
        self._ignored = ignored
        self._types: dict[str, Any] = {}
        self._raw: list[Any] = []
        self.is_recorded_with_transitions = observed
        options = RecorderOptions(keeps_transitions=observed)
        self._recorder = Recorder(tree, self._add, self._types.__setitem__, options)
        if observed:
            self.observe()

    def observe(self) -> None:
        self.tree.subscribe(self)

    def transition(self, change: Transition) -> None:
        self.transitions_of_run.append((change.tick, change.uid, change.previous, change.status))

    def _add(self, step: Any) -> None:
        self._raw.append(step)
        self.entries.append(entries_of(self.tree, self._ignored))

    def end(self) -> RunRecording:
        """End the recording, and return it."""
        self._recorder.close()
        head = self._recorder.head
        head = head._replace(types={**head.types, **self._types})
        encoder = TextEncoder()
        encoder.add(head_lines(head))
        for step in self._raw:
            encoder.add(self._recorder.lines(step))
        return read_lines(TextLines(encoder.take()), "the run")


def entries_of(tree: Tree, ignored: str = "") -> Entries:
    return [
        {
            key: (repr(entry.value).rpartition(".")[2], entry.sequence_id, entry.declared.name)
            for key, entry in list(board.local_entries().items())
            if key not in ignored
        }
        for board in scopes_of(tree)
    ]


def check_replay(run: Run, recording: RunRecording) -> None:
    """Check that a replay of *recording* does what *run* did."""
    replay = Replay(recording)
    changes: list[tuple[int, int, Status, Status]] = []
    count = 0

    class Transitions(Observer):
        def transition(self, change: Transition) -> None:
            changes.append((change.tick, change.uid, change.previous, change.status))

    replay.tree.subscribe(Transitions())
    for entries in run.entries:
        assert replay.step(), replay.difference
        assert entries_of(replay.tree, run._ignored) == entries
        step = replay.steps[replay.position - 1]
        if run.is_recorded_with_transitions:
            assert step.transitions == tuple((uid, status) for _, uid, _, status in changes[count:])
        assert (step.woken_by is not None) == (step.tick > 0)
        count = len(changes)
    observed = run.transitions_of_run
    assert (
        changes if run.is_recorded_with_transitions else changes[len(changes) - len(observed) :]
    ) == observed


def act(tree: Tree, action: str, source: Random) -> None:
    """Do to *tree* what a program may do between two ticks."""
    with suppress(NodeExecutionError):
        match action:
            case "tick":
                tree.tick_exactly_once()
                if not isinstance(tree.clock, SystemClock):
                    tree.sleep(0.01)
            case "tick once":
                tree.tick_exactly_once()
                for _ in range(3):
                    if tree.status is btcore.RUNNING and tree.context.consume_wake_up():
                        tree.tick_exactly_once()
            case "halt":
                tree.halt()
            case "write":
                tree.blackboard[source.choice("abcw")] = source.randrange(9)
                tree.blackboard["spot"] = Spot(1.0, 2.0)
            case "script":
                with suppress(ScriptError):
                    compile_script(source.choice(SCRIPTS), {"N": 2}).run(tree.blackboard)
            case "unset":
                tree.blackboard.unset("z")
            case "restore":
                backup = tree.backup_blackboards()
                tree.blackboard["x"] = source.randrange(9)
                tree.restore_blackboards(backup)
            case "inject":
                status = source.choice([btcore.SUCCESS, btcore.FAILURE])
                position, once = source.choice(list(HookPosition)), source.random() < 0.5
                uid = source.randrange(1, len(tree.nodes) + 1)
                tree.hooks.insert(Hook(uid, position, HookMode.REPLACE, status, once=once))


ACTIONS = st.lists(
    st.sampled_from(["tick"] * 6 + ["tick once", "halt", "write", "unset", "restore", "inject", "script"]),
    min_size=1,
    max_size=12,
)
DOCUMENTS = xml_documents(
    nodes=NODES, tags=TAGS, subtrees=2, conditions=True, scripts=True, timed=True, raising=True
)


def random_tree(xml: str, seed: int, clock: btcore.Clock) -> Tree:
    board = Blackboard(clock=clock)
    for key in SCRIPT_KEYS:
        board[key] = 0
    resources = [CallLog(), Random(seed)]
    return btcore.loads(xml, nodes=NODES, clock=clock, resources=resources, blackboard=board)


@settings(max_examples=int(RUNS) if RUNS else settings().max_examples // 2)
@given(DOCUMENTS, ACTIONS, st.integers(0, 2**32), st.booleans(), st.integers(0, 4), st.integers(0, 12))
def test_a_replay_repeats_the_run(
    xml: str, actions: list[str], seed: int, real_time: bool, recorded_from: int, observed_from: int
) -> None:
    tree = random_tree(xml, seed, SystemClock() if real_time else SimClock())
    for action in actions[:recorded_from]:
        act(tree, action, Random(seed))
    run = Run(tree, observed=observed_from <= recorded_from)
    for index, action in enumerate(actions[recorded_from:], start=recorded_from):
        if index == observed_from > recorded_from:
            run.observe()
        act(tree, action, Random(seed))
    check_replay(run, run.end())


def test_the_numbers_of_transitions_count_those_that_no_observer_received() -> None:
    numbers: list[int] = []

    class Numbers(Observer):
        def transition(self, change: Transition) -> None:
            numbers.append(change.number)

    b = btcore.Builder(NODES)
    tree = b.build(b.Sequence(b.Act(outcomes="S"), b.Inverter(b.AlwaysFailure())), resources=[CallLog()])
    run = Run(tree, observed=False)
    tree.tick_exactly_once()
    tree.subscribe(Numbers())
    tree.tick_exactly_once()
    count = len(numbers)
    assert numbers == list(range(count + 1, 2 * count + 1))
    check_replay(run, run.end())


@settings(max_examples=int(RUNS) // 4 if RUNS else max(10, settings().max_examples // 5))
@given(DOCUMENTS, ACTIONS, st.integers(0, 2**32), st.lists(st.integers(0, 12), max_size=6))
def test_every_moment_can_be_reached_from_every_other(
    xml: str, actions: list[str], seed: int, positions: list[int]
) -> None:
    run = Run(random_tree(xml, seed, SimClock()))
    begin = entries_of(run.tree)
    for action in actions:
        act(run.tree, action, Random(seed))
    replay = Replay(run.end())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("btcore_recorder.replay.STATE_INTERVAL", 3)
        for position in positions:
            target = min(position, len(run.entries))
            assert replay.seek(target), replay.difference
            assert entries_of(replay.tree) == [begin, *run.entries][target]
        assert replay.verify() is None


@settings(max_examples=int(RUNS) // 4 if RUNS else max(10, settings().max_examples // 5))
@given(DOCUMENTS, st.integers(0, 2**32))
def test_writes_of_another_thread_within_ticks_are_repeated(xml: str, seed: int) -> None:
    run = Run(random_tree(xml, seed, SimClock()), observed=seed % 2 == 0)
    run._ignored = "".join(SCRIPT_KEYS)  # written between the end of a tick and the reading of the entries
    ended = threading.Event()
    source = Random(seed)

    def write_on() -> None:
        while not ended.is_set():
            run.tree.blackboard[source.choice(SCRIPT_KEYS)] = source.randrange(5)

    thread = threading.Thread(target=write_on)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        thread.start()
        for action in ("tick", "tick", "halt", "tick"):
            act(run.tree, action, source)
    finally:
        ended.set()
        thread.join()
        sys.setswitchinterval(interval)
    check_replay(run, run.end())


@pytest.mark.parametrize(
    "file",
    [file for file in sorted(CASES.rglob("*.jsonl.gz")) if RUNS or file.name.startswith(("v4_", "v3_full"))],
    ids=lambda file: file.name.partition(".")[0],
)
def test_recorded_cases_replay_from_the_results_of_leaves(file: Path) -> None:
    nodes = conformance_registry()
    cases = [case for case in read_cases(file) if "ticks" in case and "load_error" not in case["expect"]]
    for case in cases if RUNS else cases[::20]:
        board: Blackboard = Format3Blackboard() if case["format"] == 3 else Blackboard()
        for key, value in case.get("bb", {}).items():
            board.set(key, value)
        arguments: dict[str, Any] = {"tree": case.get("tree"), "format": case["format"], "blackboard": board}
        try:
            tree = btcore.loads(
                case["xml"], nodes=nodes, resources=[CallLog()], clock=SimClock(), **arguments
            )
        except BtcoreError:
            continue  # a documented difference
        run = Run(tree)
        tick: Callable[[], Status] = tree.tick_once if case.get("tick") == "once" else tree.tick_exactly_once
        with suppress(NodeExecutionError):
            for _ in range(case["ticks"]):
                tick()
        check_replay(run, run.end())


def test_a_pause_because_of_the_tick_limit_is_repeated() -> None:
    repeat = '<Repeat num_cycles="-1"><AlwaysSuccess/></Repeat>'
    tree = btcore.loads(f'<root><BehaviorTree ID="Main">{repeat}</BehaviorTree></root>', tick_limit=0.01)
    run = Run(tree)
    with pytest.raises(NodeExecutionError, match="tick limit"):
        tree.tick_once()
    recording = run.end()
    assert [step.tick for step in recording.steps] == [1, 0]
    assert [type(event).__name__ for event in recording.steps[0].inputs] == ["Paused"]
    check_replay(run, recording)


def test_the_scopes_around_a_tree_are_recorded() -> None:
    outer = Blackboard()
    outer["count"] = 3
    inner = Blackboard(outer)
    inner.autoremap = True
    inner.remap("n", "count")
    b = btcore.Builder()
    tree = b.build(b.Script(code="n := n + 1; count = count * 2"), blackboard=inner)
    run = Run(tree)
    tree.tick_once()
    recording = run.end()
    assert outer["count"] == 8
    check_replay(run, recording)


@given(DOCUMENTS, ACTIONS, st.integers(0, 2**32))
@settings(max_examples=10)
def test_the_forms_of_files_lose_nothing(
    tmp_path_factory: pytest.TempPathFactory, xml: str, actions: list[str], seed: int
) -> None:
    tree = random_tree(xml.replace("\n", "\r\n"), seed, SimClock())
    for action in actions[:2]:
        act(tree, action, Random(seed))
    run = Run(tree)
    for action in actions:
        act(run.tree, action, Random(seed))
    recording = run.end()
    folder = tmp_path_factory.mktemp("forms")
    for name in ("run.btrec.txt", "run.mcap"):
        encoder = encoder_for(folder / name)
        for lines in recording_lines(recording):
            encoder.add(lines)
        (folder / name).write_bytes(encoder.take() + encoder.take_end())
        assert read_recording(folder / name) == recording


# --- differences


def recorded_door() -> RunRecording:
    b = btcore.Builder(NODES)
    tree = b.build(
        b.Sequence(b.Act(name="door", outcomes="RS|F"), b.Script(code="n := 1")), resources=[CallLog()]
    )
    run = Run(tree)
    for _ in range(3):
        tree.tick_exactly_once()
    return run.end()


@pytest.mark.parametrize(
    ("old", "new", "difference"),
    [
        (
            'result [2, "SUCCESS"]',
            'result [2, "FAILURE"]',
            "recorded: the result is SUCCESS; now: the result is FAILURE",
        ),
        ('result [2, "SUCCESS"]\n', "", "recorded: the end of the step; now: 'door' is ticked"),
        (
            "<Script",
            "<AlwaysSuccess/><Script",
            "recorded: other transitions; now: transitions with another checksum",
        ),
    ],
)
def test_the_first_difference_is_found(tmp_path: Path, old: str, new: str, difference: str) -> None:
    path = tmp_path / "door.btrec.txt"
    save_recording(path, recorded_door())
    text = re.sub(r"^transitions .*\n", "", path.read_text(), flags=re.MULTILINE)
    assert old in text
    # Without the checksums of lines, as in a file that was written by hand.
    path.write_text(
        re.sub(r"^((head|end) .*?)\d+\]$", r"\1null]", text.replace(old, new), flags=re.MULTILINE)
    )
    found = Replay(path).verify()
    assert found is not None
    assert difference in str(found)


def test_a_default_that_is_no_text_is_not_needed_for_the_replay(tmp_path: Path) -> None:
    @btcore.action
    def plan(start: btcore.In[bool | None] = None) -> bool:
        return start is None

    nodes = btcore.Registry.standard()
    nodes.add(plan)
    b = btcore.Builder(nodes)
    tree = b.build(b.Plan())
    path = tmp_path / "run.btrec.txt"
    with record(tree, path):
        tree.tick_once()
    assert Replay(path).verify() is None
