"""`btcore ros2 serve`: trees as goals of an action, as by BehaviorTree.ROS2's TreeExecutionServer."""

import importlib.util
import random
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

from btcore import Registry, Tree
from btcore.escaping import escape_controls
from btcore.extras import install_command
from btcore.program_runner import (
    FiniteRange,
    RunCommand,
    load_nodes,
    provide_resources,
    run_server,
)
from btcore.run_extension import ProgramSettings, RunExtension
from btcore.suggestions import did_you_mean
from btcore.xml.models.stubs import StubResults
from btcore_robot.robot import Phase, Robot
from btcore_ros2.errors import RosError
from btcore_ros2.parameters import declare_parameter
from btcore_ros2.session import DRAIN_RATE, RosSession, node_arguments
from btcore_ros2.tree_server import LoadedTrees, TreeServer

NODE_NAME = "bt_action_server"
"""The name of the ROS node, as in BehaviorTree.ROS2, whose parameter files can be used."""

PARAMETERS = ("action_name", "behavior_trees", "groot2_port", "plugins", "tick_frequency")
"""The ROS parameters, as in BehaviorTree.ROS2, whose `ros_plugins_timeout` is ignored."""

GROOT2_PORT = 1667

FIXED_PORT = "read-only, because viewers stay connected to this port between goals"


@click.command("serve", cls=RunCommand, short_help="Serve trees as goals of an action.")
@click.argument("trees", nargs=-1, type=click.Path(exists=True, path_type=Path))
@click.option(
    "--action-name", metavar="NAME", help="The action's name.  [default: the ROS parameter, or bt_execution]"
)
@click.option(
    "--tick-frequency",
    type=FiniteRange(0, 10_000, min_open=True),
    metavar="HZ",
    help="Ticks per second.  [default: the ROS parameter, or 100]",
)
@click.option(
    "--plugin", "plugins", multiple=True, metavar="MODULE|FILE.py", help="Load a node library. Repeatable."
)
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, metavar="N", help="Random seed."
)
@click.pass_context
def serve(ctx: click.Context, /, trees: tuple[Path, ...], **settings: Any) -> int:
    """Serve the trees in TREES, XML files or folders, as the action btcpp_ros2_interfaces/ExecuteTree.

    The parameters of BehaviorTree.ROS2's TreeExecutionServer can be given by --ros-args:
    '-p tick_frequency:=50' or '--params-file FILE.yaml'. Ctrl-C ends the server.
    """
    with ExitStack() as stack:
        try:
            arguments = node_arguments(settings.get("ros_args"))
            for option in ("action_name", "tick_frequency"):
                if settings[option] is not None:
                    arguments += ["-p", f"{option}:={settings[option]}"]
            session = stack.enter_context(RosSession(NODE_NAME, arguments=arguments))
            files = trees or _files_of_parameter(session)
            plugins = _plugins_of_parameter(session)
            nodes = _load_nodes(settings["plugins"], plugins)
            wanted = LoadedTrees(files, nodes).check()
            added: ProgramSettings = {"ros_session": session}
            settings = {**settings, **added, "fast": False}
            _publish_by_default(session, settings)
            gathered = provide_resources(ctx, settings, [RosSession, *wanted])
            resources = [*gathered.resources, random.Random(settings["seed"]), StubResults({})]
            clock: Any = session.clock
            robot = next((resource for resource in resources if isinstance(resource, Robot)), None)
            if robot is not None and robot.clock is not session.clock:
                clock = robot.clock
                robot.schedule.add_task(DRAIN_RATE, Phase.SENSORS, lambda now: session.drain())
            server = PublishedTreeServer(session, files, nodes=nodes, resources=resources, clock=clock)
        except RosError as error:
            raise click.UsageError(str(error)) from error
        _warn_about_misspelt_parameters(session)
        server.extensions, server.settings = gathered.extensions, settings
        server.has_arguments, server.plugins = bool(trees), plugins

        def run() -> None:
            with server:
                trees = ", ".join(server.tree_ids)
                session.node.get_logger().info(f"serving {trees} as the action {server.action_name}")
                server.run()

        return run_server(gathered, settings, resources, run, server.stop)


class PublishedTreeServer(TreeServer):
    """A tree server whose trees are published by the extensions of `btcore run`.

    Attributes:
        extensions: The extensions, which are attached already.
        settings: The options of the command.
        has_arguments: Whether the files are arguments of the command. They are those of the ROS parameter
            `behavior_trees` otherwise.
        plugins: The value of the ROS parameter `plugins` when the last goal began.
    """

    extensions: Sequence[RunExtension] = ()
    settings: dict[str, Any]
    has_arguments = True
    plugins: Sequence[str] = ()

    def _read_parameters(self) -> None:
        super()._read_parameters()
        if not self.has_arguments:
            self._files = _files_of_parameter(self.session)
        plugins = _plugins_of_parameter(self.session)
        if plugins != self.plugins:
            self._nodes = _load_nodes(self.settings["plugins"], plugins)
            self.plugins = plugins

    def on_tree_created(self, tree: Tree, payload: str) -> None:
        """Publish *tree* instead of the previous tree; clients stay connected."""
        for extension in self.extensions:
            extension.replace_tree(tree, self._resources, self.settings)


def _publish_by_default(session: RosSession, settings: dict[str, Any]) -> None:
    """Publish for Groot 2 at the port of the ROS parameter `groot2_port`, unless options choose otherwise."""
    port = declare_parameter(session.node, "groot2_port", GROOT2_PORT, fixed=FIXED_PORT)
    if "publish" not in settings or importlib.util.find_spec("zmq") is None:
        _warn(f"the trees are not published for Groot: {install_command('zmq')}")
        return
    settings["publish"] = settings["publish"] or ("groot2",)
    if settings["port"] is None and "groot2" in settings["publish"]:
        settings["port"] = port
        settings["port_hint"] = "; for a server that ros2 launch starts, set the ROS parameter groot2_port"


def _warn_about_misspelt_parameters(session: RosSession) -> None:
    """Warn about given ROS parameters that nothing has declared and whose names are similar to ours."""
    given = getattr(session.node, "_parameter_overrides", {})  # rclpy has no public list of them
    for name in given:
        hint = did_you_mean(name, PARAMETERS)
        if hint and name not in PARAMETERS and not session.node.has_parameter(name):
            _warn(f"the ROS parameter {name} has no effect{hint}")


def _plugins_of_parameter(session: RosSession) -> Sequence[str]:
    """Return the ROS parameter `plugins`."""
    plugins: list[str] = declare_parameter(session.node, "plugins", [])
    return plugins


def _load_nodes(given: Sequence[str], plugins: Sequence[str]) -> Registry:
    """Return the nodes of the installed libraries, of the options and of the ROS parameter `plugins`.

    Args:
        given: The values of the option `--plugin`.
        plugins: The value of the parameter.
    """
    named = list(given)
    for plugin in plugins:
        if "/" in plugin and not plugin.endswith(".py"):
            _warn(
                f"the plugin '{plugin}' of the ROS parameter is ignored: C++ libraries cannot be loaded; "
                "give a Python module or file with the same nodes"
            )
        else:
            named.append(plugin)
    return load_nodes(named)


def _files_of_parameter(session: RosSession) -> tuple[Path, ...]:
    """Return the files and folders of the ROS parameter `behavior_trees`.

    Raises:
        RosError: The parameter is not given, or names a package or folder that does not exist.
    """
    return _find_files(declare_parameter(session.node, "behavior_trees", [], check=_find_files))


def _find_files(names: Sequence[str]) -> tuple[Path, ...]:
    if not names:
        raise RosError("there are no trees to serve: give TREES, or the ROS parameter behavior_trees")
    return tuple(_find_trees(name) for name in names)


def _find_trees(name: str) -> Path:
    """Return the file or folder *name*, which may be relative to a ROS package: `package/subfolder`."""
    path = Path(name)
    if path.exists():
        return path
    package, _, rest = name.partition("/")
    try:
        from ament_index_python.packages import get_package_share_directory

        path = Path(get_package_share_directory(package), rest)
    except (OSError, LookupError, ValueError, ModuleNotFoundError) as error:
        raise RosError(f"behavior_trees: there is no file, folder or ROS package for '{name}'") from error
    if not path.exists():
        raise RosError(f"behavior_trees: the package '{package}' has no '{rest}'")
    return path


def _warn(message: str) -> None:
    click.echo(f"warning: {escape_controls(message)}", err=True)
