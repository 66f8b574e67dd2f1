"""`btcore ros2 navigator`: a navigator in place of Nav2's bt_navigator."""

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from btcore import Run
from btcore.clock import NS_PER_S
from btcore.field_options import FiniteRange, add_options
from btcore.program_runner import GivenSettings, ProviderCommand, TreelessProgram, create_run
from btcore_ros2.providers import RosSettings, open_session

if TYPE_CHECKING:
    from btcore_ros2.nav2.navigator_server import NavigatorServer

TICK_RATE: Final = 100.0
"""The default rate (Hz) of ticks: that of Nav2's `bt_loop_duration` of 10 ms."""

PUBLISH_PERIOD_NS: Final = NS_PER_S // 10
"""The time (ns) between two checks whether a goal has a new tree."""

_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command("navigator", cls=ProviderCommand, short_help="Take the place of Nav2's bt_navigator.")
@click.option(
    "--to-pose",
    type=_FILE,
    metavar="FILE.xml",
    help="Tree for NavigateToPose.  [default: navigate_to_pose_w_replanning_and_recovery.xml of btcore]",
)
@click.option(
    "--through-poses",
    type=_FILE,
    metavar="FILE.xml",
    help="Tree for NavigateThroughPoses.  [default: the tree of btcore]",
)
@click.option(
    "--tick-frequency",
    type=FiniteRange(0, 10_000, min_open=True),
    default=TICK_RATE,
    show_default=True,
    metavar="HZ",
    help="Ticks per second.",
)
@click.option(
    "--plugin", "plugins", multiple=True, metavar="MODULE", help="Library with further nodes; repeatable."
)
@add_options(RosSettings)
@click.pass_context
def navigator(
    ctx: click.Context,
    /,
    to_pose: Path | None,
    through_poses: Path | None,
    tick_frequency: float,
    plugins: tuple[str, ...],
    settings: GivenSettings,
) -> int:
    """Serve Nav2's actions navigate_to_pose and navigate_through_poses with btcore's trees.

    Start Nav2 without bt_navigator. The trees send goals to Nav2's servers, such as planner_server and
    controller_server. A goal may name another tree in the field behavior_tree. Ctrl-C cancels the goals and
    ends the navigator, and so does a client that shuts down the lifecycle node bt_navigator.
    """
    ros = settings.of(RosSettings)
    if ros.lockstep:
        raise click.UsageError("--lockstep does not belong here: the navigator runs in real time")
    with open_session(ros, name="bt_navigator") as session:
        # Imported here: ROS 2 is installed, since there is a session.
        from btcore_ros2.nav2.navigator_server import NavigatorServer

        server = NavigatorServer(session, to_pose, through_poses, plugins=plugins, rate=tick_frequency)
        session.node.get_logger().info("waiting for goals of navigate_to_pose and navigate_through_poses")
        with create_run(ctx, TreelessProgram("Navigator"), settings, resources=[session]) as run:
            stopped = threading.Event()
            run.run_until_signal(lambda: _serve(server, run, stopped), stopped.set)
    return run.exit_code


def _serve(server: "NavigatorServer", run: Run, stopped: threading.Event) -> None:
    """Serve goals until *stopped* is set; the providers of *run* publish the tree of the latest goal."""
    clock = server.session.clock
    while not (stopped.is_set() or server.is_shut_down):
        # The wait ticks the trees. A signal handler must not set the event of a wait, which has a lock.
        clock.wait_until(clock.now() + PUBLISH_PERIOD_NS, threading.Event())
        if server.tree is not None and server.tree is not run.tree:
            run.replace_tree(server.tree)
    server.close()
