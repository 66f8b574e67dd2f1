"""`btcore ros2 navigator`: a navigator in place of Nav2's bt_navigator."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from btcore import RegistrationError, Tree
from btcore.program_runner import FiniteRange, RunCommand, require_resources, run_program
from btcore_ros2.errors import RosError
from btcore_ros2.session import RosSession, node_arguments

if TYPE_CHECKING:
    from btcore_ros2.nav2.navigator_server import NavigatorServer

TICK_RATE = 100.0
"""The default rate (Hz) of ticks: that of Nav2's `bt_loop_duration` of 10 ms."""

_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command("navigator", cls=RunCommand, short_help="Take the place of Nav2's bt_navigator.")
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
@click.pass_context
def navigator(ctx: click.Context, /, **settings: Any) -> int:
    """Serve Nav2's actions navigate_to_pose and navigate_through_poses with btcore's trees.

    Start Nav2 without bt_navigator. The trees send goals to Nav2's servers, such as planner_server and
    controller_server. A goal may name another tree in the field behavior_tree. Ctrl-C cancels the goals and
    ends the navigator, and so does a client that shuts down the lifecycle node bt_navigator.
    """
    with ExitStack() as stack:
        try:
            arguments = node_arguments(settings.get("ros_args"))
            session = stack.enter_context(RosSession("bt_navigator", arguments=arguments))
            # Imported here: ROS 2 is installed, since there is a session.
            from btcore_ros2.nav2.navigator_server import NavigatorServer

            server = NavigatorServer(
                session,
                settings["to_pose"],
                settings["through_poses"],
                plugins=settings["plugins"],
                rate=settings["tick_frequency"],
            )
        except (RosError, RegistrationError, ValueError) as error:
            raise click.UsageError(str(error)) from error
        session.node.get_logger().info("waiting for goals of navigate_to_pose and navigate_through_poses")
        return _run(ctx, server, {**settings, "duration": None, "fast": False})


def _run(ctx: click.Context, server: "NavigatorServer", settings: dict[str, Any]) -> int:
    """Serve goals until a signal arrives, and return the exit code. Extensions publish the running tree."""
    gathered = require_resources(ctx, settings, (), used=["--ros-args"])
    published: Tree | None = None

    def publish() -> bool:
        nonlocal published
        if server.tree is not None and server.tree is not published:
            published = server.tree
            for extension in gathered.extensions:
                extension.replace_tree(published, (), settings)
        return not server.is_shut_down

    clock = server.session.clock
    done = run_program("Navigator", gathered, settings, server.close, clock=clock, keep_running=publish)
    return done.code
