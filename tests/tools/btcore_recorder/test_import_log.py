"""Logs of statuses as recordings: their replay makes the transitions of the log."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import pytest
from click.testing import CliRunner, Result
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import btcore
from btcore import (
    FAILURE,
    IDLE,
    RUNNING,
    SUCCESS,
    Observer,
    Registry,
    SimClock,
    Status,
    SystemClock,
    Transition,
)
from btcore.cli.main import main
from btcore.logs import BtLog, Recording, read_log
from btcore.logs.files import LogError
from btcore_recorder import Replay, inputs, record
from btcore_recorder.files import read_recording
from btcore_recorder.import_log import import_log
from btcore_recorder.moments import Moments
from tests.tools.btcore_bags.test_bags import EVENTS, XML, write_nav2_bag
from tests.tools.btcore_recorder.test_replay import ACTIONS, DOCUMENTS, act, random_tree

DOOR = """<root BTCPP_format="4"><BehaviorTree ID="Door"><Sequence>
  <RetryUntilSuccessful num_attempts="3"><Sequence>
    <Sleep name="knock" msec="500"/>
    <Script name="count" code="tries += 1"/>
    <ScriptCondition name="is_open" code="tries &gt; 1"/>
  </Sequence></RetryUntilSuccessful>
  <Sleep name="walk_in" msec="1500"/>
</Sequence></BehaviorTree></root>"""

Command = Callable[..., Result]
Changes = list[tuple[int, Status]]


def replayed(recording: inputs.RunRecording) -> Changes:
    """Return the transitions of a replay, which must not differ from its recording."""
    changes: Changes = []

    class Collector(Observer):
        def transition(self, change: Transition) -> None:
            changes.append((change.uid, change.status))

    replay = Replay(recording)
    replay.tree.subscribe(Collector())
    assert replay.verify() is None
    return changes


def logged(log: Recording) -> Changes:
    return [(change.uid, change.status) for change in log.transitions]


def has_skipped_child(log: Recording, uid: int) -> bool:
    """Return whether a SubTree node may skip its SubTree child, which the engine ticks nevertheless."""
    nodes = [log.nodes[uid], *(log.nodes[child] for child in log.nodes[uid].children)]
    is_inner = all(node.id == "SubTree" for node in nodes) and len(nodes) == 2
    return is_inner and not nodes[-1].ports.keys().isdisjoint(("_skipIf", "_while"))


@settings(max_examples=max(10, settings().max_examples // 3))
@given(DOCUMENTS, ACTIONS, st.integers(0, 2**32), st.booleans(), st.integers(0, 3), st.floats(0.5, 1.0))
def test_the_replay_of_a_log_has_its_transitions(
    xml: str, actions: list[str], seed: int, real_time: bool, logged_from: int, part: float
) -> None:
    tree = random_tree(xml, seed, SystemClock() if real_time else SimClock())
    for action in actions[:logged_from]:
        assume(action != "inject" or len(tree.subtrees) == 1)
        act(tree, action, Random(seed))
    with TemporaryDirectory() as folder:
        with BtLog(tree, Path(folder) / "run.btlog"):
            for action in actions[logged_from:]:
                # The engine runs SubTree nodes, of which a log does not say that their result is injected.
                if action != "inject" or len(tree.subtrees) == 1:
                    act(tree, action, Random(seed))
        log = read_log(Path(folder) / "run.btlog")
    assume(not any(has_skipped_child(log, uid) for uid in log.nodes))
    whole, cut = logged(log), int(part * len(log.transitions))
    assert replayed(import_log(log)) == whole
    # The engine completes the tick in which a log ends.
    assert replayed(import_log(replace(log, transitions=log.transitions[:cut])))[:cut] == whole[:cut]


@pytest.mark.parametrize("condition", ["_successIf", "_failureIf"])
def test_the_condition_of_a_subtree_within_a_subtree_decides(tmp_path: Path, condition: str) -> None:
    tree = btcore.loads(
        f"""<root BTCPP_format="4" main_tree_to_execute="Main">
        <BehaviorTree ID="Main"><Sequence><AlwaysSuccess/><SubTree ID="Outer"/></Sequence></BehaviorTree>
        <BehaviorTree ID="Outer"><SubTree ID="Inner" {condition}="@n == 1"/></BehaviorTree>
        <BehaviorTree ID="Inner"><Sequence><AlwaysSuccess/><Sleep msec="1000"/></Sequence></BehaviorTree>
        </root>""",
        clock=SimClock(),
    )
    with BtLog(tree, tmp_path / "run.btlog"):
        for number in (0, 1, 1, 0):
            tree.blackboard["n"] = number
            tree.tick_exactly_once()
            tree.halt()
    log = read_log(tmp_path / "run.btlog")
    assert replayed(import_log(log)) == logged(log)


@pytest.mark.parametrize("name", ["v4_sample.btlog", "v4_sample.db3", "v3_sample.fbl"])
def test_logs_of_behaviortree_cpp_are_imported(name: str, captures: Path) -> None:
    log = read_log(captures / name)
    assert replayed(import_log(log)) == logged(log)


def test_bag_of_nav2_is_imported_with_its_subtrees(tmp_path: Path) -> None:
    events = [
        *EVENTS[:2],
        (3, "Again", "IDLE", "RUNNING"),
        EVENTS[2],
        (4, "Wait", "SUCCESS", "IDLE"),
        (3, "Again", "RUNNING", "SUCCESS"),
    ]
    bag = write_nav2_bag(tmp_path / "nav.mcap", events)
    (tmp_path / "nav.xml").write_text(XML)
    log = read_log(bag)
    imported = import_log(log)
    assert replayed(imported) == logged(log)
    moments = Moments(imported)
    assert [tree for tree in moments.plans.trees if tree.startswith("Recover")] == ["Recover", "Recover#5"]
    assert moments.at(moments.count).statuses == (RUNNING, FAILURE, SUCCESS, IDLE, IDLE, IDLE)


@pytest.fixture
def btcore_command() -> Command:
    return lambda *arguments: CliRunner().invoke(main, [*map(str, arguments)], prog_name="btcore")


@pytest.fixture
def door(tmp_path: Path) -> tuple[Path, Path]:
    """The log and the recording of a run."""
    tree = btcore.loads(DOOR, nodes=Registry.standard(), clock=SimClock())
    tree.blackboard["tries"] = 0
    paths = tmp_path / "door.btlog", tmp_path / "door.btrec.txt"
    with BtLog(tree, paths[0]), record(tree, paths[1]):
        tree.tick_while_running(period=0.1)
    return paths


def test_the_import_has_the_results_and_times_of_the_run(door: tuple[Path, Path]) -> None:
    log, recorded = (read_log(path) for path in door)
    imported = import_log(log)
    assert logged(recorded) == logged(log) == replayed(imported)
    assert [round(step.time / 1e9, 3) for step in imported.steps] == [0.0, 0.5, 1.0, 2.5]
    is_open = next(node.uid for node in log.nodes.values() if node.name == "is_open")
    events = [event for step in imported.steps for event in step.inputs]
    assert [
        event.status for event in events if isinstance(event, inputs.Result) and event.uid == is_open
    ] == [
        FAILURE,
        SUCCESS,
    ]
    # The engine runs the nodes whose results depend on their children alone.
    engine_run = [node.uid for node in log.nodes.values() if node.uid not in imported.head.replaced]
    assert [log.nodes[uid].id for uid in engine_run] == ["Sequence", "RetryUntilSuccessful", "Sequence"]


def test_the_command_writes_a_recording_that_is_marked(
    door: tuple[Path, Path], btcore_command: Command, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "imported.btrec.txt"
    done = btcore_command("replay", door[0], "--save-recording", file)
    assert (done.exit_code, done.stdout) == (0, f"{file}: 4 ticks of {door[0]}\n")
    assert "reconstructed from the statuses in 'door.btlog'" in done.stderr
    assert btcore_command("replay", file, "--verify").exit_code == 0
    assert "reconstructed from the statuses in 'door.btlog'" in caplog.text
    assert btcore_command("diff", file, door[1]).exit_code == 0


def test_the_command_converts_a_recording_to_its_other_form(
    door: tuple[Path, Path], btcore_command: Command, tmp_path: Path
) -> None:
    pytest.importorskip("mcap")
    for source, name in ((door[1], "run.mcap"), (tmp_path / "run.mcap", "again.btrec.txt")):
        assert btcore_command("replay", source, "--save-recording", tmp_path / name).exit_code == 0
    assert (tmp_path / "again.btrec.txt").read_bytes() == door[1].read_bytes()
    assert read_recording(tmp_path / "run.mcap") == read_recording(door[1])


def test_a_status_that_nothing_explains_is_set(door: tuple[Path, Path]) -> None:
    log = read_log(door[0])
    # A gap: a part of the transitions is missing.
    transitions = [change for index, change in enumerate(log.transitions) if index % 3 != 1]
    gap = replace(log, transitions=transitions)
    changes = replayed(import_log(gap))
    assert changes.count((1, RUNNING)) == 1
    assert set(logged(gap)) <= set(changes)


def test_a_log_without_a_tree_is_refused(door: tuple[Path, Path]) -> None:
    log = read_log(door[0])
    names = {uid: replace(node, children=()) for uid, node in log.nodes.items()}
    with pytest.raises(LogError, match="the names of 7 nodes, but not their tree"):
        import_log(replace(log, nodes=names))
