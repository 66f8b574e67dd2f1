"""The studio watches a published tree, sets breakpoints in it, and changes it."""

import threading
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest

import btcore
from btcore.runs.live_state import LiveState
from btcore_monitor.errors import MonitorError
from btcore_monitor.keys import ClientKeys, RobotKeys, create_keys
from btcore_monitor.live_extension import RobotConnection, RobotExtension
from btcore_monitor.serve import serve
from btcore_monitor.watch.address import AddressError

XML = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence name="Küche">
      <Script name="same" code="lap := 3"/><AlwaysSuccess name="same"/><SubTree ID="Inner" name="hello"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Inner"><ForceSuccess><AlwaysFailure/></ForceSuccess></BehaviorTree>
</root>"""


@pytest.fixture
def tree() -> btcore.Tree:
    return btcore.loads(XML)


@pytest.fixture
def connection(tree: btcore.Tree) -> Iterator[RobotConnection]:
    with (
        serve(tree, groot2_port=0, allow_control=True, allow_changes=True) as publisher,
        closing(RobotExtension().connect(publisher.address)) as connection,
    ):
        assert isinstance(connection, RobotConnection)
        yield connection


def until(connection: RobotConnection, holds: Callable[[LiveState], object]) -> LiveState:
    for _ in range(200):
        state = connection.poll(0.05)
        if holds(state):
            return state
    raise AssertionError(f"not reached: {state}")


def test_nodes_statuses_results_and_entries_arrive(tree: btcore.Tree, connection: RobotConnection) -> None:
    state = until(connection, lambda state: state.nodes)
    assert [(node.uid, node.parent, node.id, node.type == "subtree") for node in state.nodes] == [
        (1, 0, "Sequence", False),
        (2, 1, "Script", False),
        (3, 1, "AlwaysSuccess", False),
        (4, 1, "SubTree", True),
        (5, 4, "ForceSuccess", False),
        (6, 5, "AlwaysFailure", False),
    ]
    assert state.nodes[0].name == "Küche"
    tree.tick_once()
    state = until(connection, lambda state: len(state.results) == 6 and state.entries)
    assert state.connection == "connected"
    assert state.results == {1: 2, 2: 2, 3: 2, 4: 2, 5: 2, 6: 3}
    assert state.entries == (("", "lap", "3"),)


def test_results_before_the_connection_arrive_from_a_robot_without_run_channel(tree: btcore.Tree) -> None:
    with serve(tree, groot2_port=0, run_channel=False) as publisher:
        tree.tick_once()
        with closing(RobotConnection(publisher.address)) as connection:
            state = until(connection, lambda state: state.results)
    assert state.results == {1: 2, 2: 2, 3: 2, 4: 2, 5: 2, 6: 3}


def test_breakpoint_stops_at_one_of_two_equal_names(tree: btcore.Tree, connection: RobotConnection) -> None:
    until(connection, lambda state: state.nodes)
    connection.set_breakpoints([3])
    ticking = threading.Thread(target=tree.tick_once, daemon=True)
    ticking.start()
    state = until(connection, lambda state: state.stopped_at)
    assert (state.stopped_at, state.breakpoints, state.problem) == (3, {3}, "")
    connection.release()
    ticking.join(timeout=90)
    assert not ticking.is_alive()
    connection.set_breakpoints([])
    assert connection.poll(0.01).breakpoints == frozenset()
    tree.tick_once()


def test_value_is_set_and_status_is_forced_at_a_breakpoint(
    tree: btcore.Tree, connection: RobotConnection
) -> None:
    with pytest.raises(MonitorError, match="no robot is connected"):
        connection.set_entry("", "lap", "5")
    state = until(connection, lambda state: state.refusals)
    assert (state.refusals["breakpoints"], state.refusals["values"]) == ("", "")
    connection.set_breakpoints([3])
    ticking = threading.Thread(target=tree.tick_once, daemon=True)
    ticking.start()
    # What the stopped tick has written arrives, although the tick has not ended.
    until(connection, lambda state: state.stopped_at and ("", "lap", "3") in state.entries)
    connection.set_entry("", "lap", "4")
    until(connection, lambda state: ("", "lap", "4") in state.entries)
    with pytest.raises(MonitorError, match="no entry 'lop'; did you mean 'lap'"):
        connection.set_entry("", "lop", "5")
    connection.release("FAILURE")
    ticking.join(timeout=90)
    assert (tree.status, tree.blackboard["lap"]) == (btcore.FAILURE, 4)
    # The next tick stops again, and the node is ticked unless a status is forced again.
    ticking = threading.Thread(target=tree.tick_once, daemon=True)
    ticking.start()
    until(connection, lambda state: state.stopped_at)
    connection.release()
    ticking.join(timeout=90)
    assert tree.status is btcore.SUCCESS


def test_breakpoints_can_be_set_in_a_tree_that_replaces_an_equal_one(tree: btcore.Tree) -> None:
    with (
        serve(tree, groot2_port=0, allow_control=True) as publisher,
        closing(RobotConnection(publisher.address)) as connection,
    ):
        first = until(connection, lambda state: state.nodes)
        connection.set_breakpoints([3])
        publisher.replace_tree(btcore.loads(XML))
        state = until(connection, lambda state: state.nodes is not first.nodes)
        assert state.breakpoints == frozenset()


def test_robot_without_control_is_reported(tree: btcore.Tree) -> None:
    with serve(tree, groot2_port=0) as publisher, closing(RobotConnection(publisher.address)) as connection:
        until(connection, lambda state: state.nodes)
        connection.set_breakpoints([3])
        state = until(connection, lambda state: state.refusals)
        assert "does not allow control" in state.problem
        assert not state.breakpoints
        assert "--allow-changes" in state.refusals["values"]


def test_robot_with_groot1_is_watched_but_has_no_breakpoints(tree: btcore.Tree) -> None:
    with (
        serve(tree, groot2_port=None, groot1_port=0, run_channel=False) as publisher,
        closing(RobotConnection(publisher.address)) as connection,
    ):
        until(connection, lambda state: state.nodes)
        connection.set_breakpoints([3])
        assert "Groot 1's protocol" in connection.poll(0.01).problem
        tree.tick_once()
        assert until(connection, lambda state: len(state.results) == 6).results[6] == 3


def test_robot_with_keys_is_watched_and_controlled_by_clients_only(tree: btcore.Tree, tmp_path: Path) -> None:
    create_keys(tmp_path / "robot")
    create_keys(tmp_path / "desk")
    create_keys(tmp_path / "unknown_client")
    allowed = RobotKeys(tmp_path / "robot", [str(tmp_path / "desk.pub")])
    with serve(tree, groot2_port=0, allow_control=True, keys=allowed) as publisher:

        def connect(name: str) -> RobotConnection:
            return RobotConnection(
                publisher.address, ClientKeys(tmp_path / name, str(tmp_path / "robot.pub"))
            )

        with closing(connect("desk")) as connection:
            until(connection, lambda state: state.nodes)
            connection.set_breakpoints([3])
            state = connection.poll(0.01)
            assert (state.breakpoints, state.problem) == ({3}, "")
        with (
            closing(connect("unknown_client")) as connection,
            pytest.raises(MonitorError, match="does not know this key"),
        ):
            until(connection, lambda state: state.nodes)
        with (
            closing(RobotConnection(publisher.address)) as connection,
            pytest.raises(MonitorError, match="keys"),
        ):
            until(connection, lambda state: state.nodes)


def test_invalid_address_is_an_error() -> None:
    with pytest.raises(AddressError, match="not an address"):
        RobotExtension().connect("http://x/y z")


@pytest.mark.parametrize(
    ("leaf", "ending", "raised_at"),
    [
        ("<AlwaysFailure/>", "the tree returned FAILURE", 0),
        ('<Script code="a = 1"/>', "node 'Script::2' <Script> raised while ticking: ScriptError: ", 2),
    ],
)
def test_end_of_a_run_has_its_result_or_its_error(leaf: str, ending: str, raised_at: int) -> None:
    tree = btcore.loads(
        f'<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>{leaf}</Sequence></BehaviorTree></root>'
    )
    publisher = serve(tree, groot2_port=0)
    with closing(RobotConnection(publisher.address)) as connection:
        until(connection, lambda state: state.nodes)
        with suppress(btcore.BtcoreError):
            tree.tick_once()
        # It waits until the connection has received the end.
        end = threading.Thread(target=publisher.close, daemon=True)
        end.start()
        state = until(connection, lambda state: state.connection == "ended")
    end.join(timeout=90)
    assert ending in state.detail
    assert state.raised_at == raised_at
