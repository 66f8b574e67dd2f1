"""Breakpoints from code and from the command line, in a running robot."""

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import btcore
from btcore import SimClock
from btcore.cli.main import main
from btcore.engine.node import start_tick_counts
from btcore_monitor.breakpoints import BreakpointClient, BreakpointError, find_nodes
from btcore_monitor.events import ObservedNode, ObservedTree
from btcore_monitor.serve import serve

pytestmark = pytest.mark.usefixtures("no_threads_left")
ROOT = Path(__file__).parents[2]

LIMIT = 60.0
"""The longest wait (s) for anything, on a slow machine."""
PYTHON_PATH = os.pathsep.join([str(ROOT), str(ROOT / "monitor")])
PATROL = """
<root BTCPP_format="4" main_tree_to_execute="Patrol">
  <BehaviorTree ID="Patrol">
    <KeepRunningUntilFailure>
      <Fallback name="choose">
        <SubTree ID="Move" name="go"/>
        <AlwaysSuccess name="rescue"/>
      </Fallback>
    </KeepRunningUntilFailure>
  </BehaviorTree>
  <BehaviorTree ID="Move">
    <Sequence name="legs"><AlwaysSuccess name="left"/><AlwaysSuccess name="right"/></Sequence>
  </BehaviorTree>
</root>
"""


class Robot:
    """A tree that ticks on a thread of its own."""

    def __init__(self, port: int = 0) -> None:
        self.tree = btcore.loads(PATROL, resources=[SimClock()])
        # Between two commands, a slow machine may need longer than the default permits.
        self.publisher = serve(
            self.tree, groot2_port=port, run_channel=False, allow_control=True, max_heartbeat_delay=LIMIT
        )
        self.address = self.publisher.address
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def start(self) -> None:
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(0.002):
            self.tree.tick_exactly_once()

    def end(self) -> None:
        self._stop.set()
        self.publisher.close()
        if self._thread.ident is not None:
            self._thread.join(60)
            assert not self._thread.is_alive()


@pytest.fixture
def robot() -> Iterator[Robot]:
    robot = Robot()
    yield robot
    robot.end()


def hook(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["hook", "--wait", str(LIMIT), *arguments])


def observed_tree(*names: str) -> ObservedTree:
    nodes = tuple(
        ObservedNode(uid, name.rpartition("/")[2], "Work", "action", name)
        for uid, name in enumerate(names, start=1)
    )
    return ObservedTree("0" * 32, "Main", nodes)


@pytest.mark.parametrize(
    ("pattern", "found"),
    [
        ("Move/left", ["Move/left"]),
        ("left", ["Move/left", "Turn/left"]),
        ("Move/*", ["Move/left", "Move/right"]),
        ("*gh?", ["Move/right"]),
        ("odd[1]", ["odd[1]"]),
    ],
)
def test_a_pattern_is_a_path_a_name_or_a_glob(pattern: str, found: list[str]) -> None:
    nodes = find_nodes(observed_tree("Move/left", "Move/right", "Turn/left", "odd[1]"), pattern)
    assert [node.path for node in nodes] == found


def test_a_pattern_without_a_match_raises_with_a_suggestion() -> None:
    with pytest.raises(BreakpointError, match=r"no node 'Move/Rihgt'; did you mean 'Move/right'\?"):
        find_nodes(observed_tree("Move/left", "Move/right"), "Move/Rihgt")


def test_a_breakpoint_before_the_first_tick_holds_the_robot_until_it_is_released(robot: Robot) -> None:
    with BreakpointClient(robot.address) as breaks:
        assert breaks.break_at("go/l*") == ["go/legs", "go/left"]
        robot.start()
        assert breaks.wait(LIMIT).path == "go/legs"
        assert breaks.status("left") == "IDLE"
        breaks.release("go/legs", remove=True)
        assert breaks.wait(LIMIT).path == "go/left"
        assert breaks.status("legs") == "RUNNING"
        assert robot.tree.ticks == 1
        breaks.clear()
        assert breaks.hooks() == []


def test_a_release_can_set_the_nodes_status(robot: Robot) -> None:
    with BreakpointClient(robot.address) as breaks:
        breaks.break_at("left", after=True)
        robot.start()
        breaks.wait(LIMIT)
        breaks.break_at("rescue")
        breaks.release("left", "failure", remove=True)
        assert breaks.wait(LIMIT).path == "rescue"
        assert breaks.status("choose") == "RUNNING"


def test_disabled_hooks_do_not_stop_robot_and_stay_listed(robot: Robot, until: Callable[..., None]) -> None:
    with BreakpointClient(robot.address) as breaks:
        breaks.break_at("left")
        robot.start()
        assert breaks.wait(LIMIT).path == "go/left"
        breaks.disable()
        until(lambda: robot.tree.ticks > 3, "the robot goes on")
        assert [hook.enabled for hook in breaks.hooks()] == [False]


def test_a_status_is_injected_into_one_tick(robot: Robot) -> None:
    tally = start_tick_counts(robot.tree.node("rescue"))
    robot.start()
    with BreakpointClient(robot.address) as breaks:
        assert breaks.inject("right", 3) == ["go/right"]
        assert breaks.wait(LIMIT).path == "go/right"
        breaks.step()
        assert tally.success == 1
        assert [hook.uid for hook in breaks.hooks()] == [1]


def test_the_tree_is_stepped_tick_by_tick(robot: Robot) -> None:
    robot.start()
    with BreakpointClient(robot.address) as breaks:
        breaks.step(0)
        ticks = robot.tree.ticks
        for more in range(1, 4):
            breaks.step()
            assert robot.tree.ticks == ticks + more
        breaks.step(10)
        assert robot.tree.ticks == ticks + 13


def test_a_step_ends_at_another_breakpoint_on_the_way(robot: Robot) -> None:
    robot.start()
    with BreakpointClient(robot.address) as breaks:
        breaks.step(0)
        breaks.break_at("right")
        assert breaks.step().path == "go/right"


def test_a_robot_waits_at_a_breakpoint_as_long_as_a_client_is_connected(until: Callable[..., None]) -> None:
    tree = btcore.loads(PATROL, resources=[SimClock()])
    with serve(
        tree, groot2_port=0, run_channel=False, allow_control=True, max_heartbeat_delay=3.0
    ) as publisher:
        tick = threading.Thread(target=tree.tick_exactly_once)
        with BreakpointClient(publisher.address) as breaks:
            breaks.break_at("left")
            tick.start()
            breaks.wait(LIMIT)
            tick.join(4)
            assert tick.is_alive()
        tick.join(60)
        assert not tick.is_alive()


def test_a_restarted_robot_gets_its_breakpoints_again(robot: Robot, until: Callable[..., None]) -> None:
    with BreakpointClient(robot.address) as breaks:
        breaks.break_at("left")
        before = breaks.tree.tree_id
        port = robot.publisher.port
        robot.end()
        again = Robot(port)
        try:
            until(lambda: breaks.tree.tree_id != before and again.tree.hooks.all(), "set again")
            again.start()
            until(lambda: breaks.status("go/legs") == "RUNNING", "stops before the client waits")
            assert breaks.wait(LIMIT).path == "go/left"
        finally:
            again.end()


def test_a_client_waits_for_a_robot_that_starts_later() -> None:
    robots: list[Robot] = []
    with serve(btcore.loads(PATROL), groot2_port=0, run_channel=False) as publisher:
        port = publisher.port
    late = threading.Timer(0.3, lambda: robots.append(Robot(port)))
    late.start()
    try:
        with BreakpointClient(f"{port}", timeout=60) as breaks:
            assert breaks.break_at("left") == ["go/left"]
    finally:
        late.join()
        robots[0].end()


def test_the_error_of_a_robot_without_control_names_the_missing_option() -> None:
    tree = btcore.loads(PATROL)
    with (
        serve(tree, groot2_port=0, run_channel=False) as publisher,
        BreakpointClient(publisher.address) as breaks,
        pytest.raises(BreakpointError, match="start it with --allow-control"),
    ):
        breaks.break_at("left")


def test_requests_that_cannot_be_fulfilled_raise_with_details(robot: Robot) -> None:
    with BreakpointClient(robot.address) as breaks:
        with pytest.raises(BreakpointError, match="no breakpoint at 'left': the robot has no hooks"):
            breaks.release("left")
        breaks.break_at("right")
        with pytest.raises(BreakpointError, match="the robot's hooks are at go/right"):
            breaks.clear("left")
        with pytest.raises(BreakpointError, match="cannot inject 'RUNNING'"):
            breaks.inject("left", "RUNNING")
        with pytest.raises(BreakpointError, match=r"no breakpoint was reached within 0.01 s"):
            breaks.wait(0.01)
        with pytest.raises(BreakpointError, match=r"no tick began within 0\.01 s"):
            breaks.step(timeout=0.01)


def test_the_command_injects_a_status_and_lists_and_clears_hooks(robot: Robot) -> None:
    robot.start()
    assert hook(robot.address, "inject", "left", "failure").stdout == "go/left: FAILURE\n"
    assert hook(robot.address, "list").stdout == "no hooks\n"
    assert hook(robot.address, "break", "right", "--leave").stdout == "breakpoint before go/right\n"
    assert hook(robot.address, "list").stdout == "breakpoint before go/right\n"
    assert hook(robot.address, "release", "right").stdout == "released go/right\n"
    assert hook(robot.address, "clear").stdout == "cleared go/right\n"
    assert "stopped before the next tick; running: " in hook(robot.address, "step", "2").stdout


def test_commands_that_set_hooks_warn_about_hooks_of_other_clients(robot: Robot) -> None:
    robot.start()
    with BreakpointClient(robot.address) as other:
        other.inject("rescue", "FAILURE", once=False)
        warning = (
            "warning: other clients left hooks in the robot: injects before rescue FAILURE. A breakpoint "
            "stops the tree while a client is connected. To remove all hooks: "
            f"btcore hook {robot.address} clear\n"
        )

        assert hook(robot.address, "inject", "left", "FAILURE").stderr == warning
        assert hook(robot.address, "step", "1").stderr.startswith(warning)
        assert warning not in hook(robot.address, "break", "rescue", "--leave").stderr
        assert hook(robot.address, "list").stderr == ""


def test_the_command_watches_breakpoints_until_the_last_is_released(robot: Robot) -> None:
    robot.start()
    arguments = [robot.address, "break", "left", "right", "--once", "--duration", "60"]
    watching = subprocess.Popen(
        [sys.executable, "-m", "btcore", "hook", "--wait", str(LIMIT), *arguments],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": PYTHON_PATH},
    )
    assert watching.stdout is not None
    message = [watching.stdout.readline() for _ in range(3)]
    assert message == ["breakpoint before go/left\n", "breakpoint before go/right\n", "reached go/left\n"]
    with BreakpointClient(robot.address) as breaks:
        breaks.release("left")
        assert watching.stdout.readline() == "reached go/right\n"
        breaks.release("right")
    assert watching.wait(60) == 0
    watching.stdout.close()
    assert robot.tree.hooks.all() == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["127.0.0.1:1", "--wait", "0.1", "list"], "no robot answers at tcp://127.0.0.1:1"),
        (["not an address", "list"], "'not an address' is not an address"),
        (["relaese"], "there is no command 'relaese'; did you mean 'release'?"),
        (["1", "inject", "left", "RUNNING"], "'RUNNING' is not one of"),
    ],
)
def test_a_usage_error_is_reported_with_exit_code_2(arguments: list[str], message: str) -> None:
    result = hook(*arguments)
    assert result.exit_code == 2
    assert isinstance(result.exception, SystemExit)
    assert message in result.stderr


def test_ctrl_c_ends_a_run_that_waits_at_a_breakpoint(tmp_path: Path) -> None:
    (tmp_path / "patrol.xml").write_text(PATROL)
    options = ["--until", "never", "--publish", "groot2", "--allow-control", "--port", "0"]
    run = subprocess.Popen(
        [sys.executable, "-m", "btcore", "run", str(tmp_path / "patrol.xml"), *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": PYTHON_PATH},
    )
    try:
        assert run.stderr is not None
        published = re.search(r"publishing at (\S+)", run.stderr.readline())
        assert published is not None
        with BreakpointClient(published[1], timeout=LIMIT) as breaks:
            breaks.break_at("left")
            breaks.wait(LIMIT)
            run.send_signal(signal.SIGINT)
            message = run.communicate(timeout=LIMIT)[1]
        assert run.returncode == 130
        assert "interrupted" in message
    finally:
        run.kill()
        run.wait()
