"""`btcore ros2 serve`: trees as goals of an action, as by BehaviorTree.ROS2's TreeExecutionServer."""

import importlib.util
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import click
import msgspec

from btcore import Registry, Run, RunSettings, Tree
from btcore.errors import SettingsError
from btcore.escaping import escape_controls
from btcore.extras import install_command
from btcore.field_options import FiniteRange, add_options
from btcore.program_runner import (
    GivenSettings,
    ProviderCommand,
    TreelessProgram,
    create_run,
    load_nodes,
)
from btcore.suggestions import did_you_mean
from btcore_robot.robot import Robot
from btcore_ros2.errors import RosError
from btcore_ros2.parameters import declare_parameter
from btcore_ros2.providers import RosRobotSettings, RosSettings, open_session
from btcore_ros2.session import RosSession
from btcore_ros2.tree_server import LoadedTrees, TreeServer

NODE_NAME = "bt_action_server"
"""The name of the ROS node, as in BehaviorTree.ROS2, whose parameter files can be used."""

PARAMETERS = ("action_name", "behavior_trees", "groot2_port", "plugins", "tick_frequency")
"""The ROS parameters, as in BehaviorTree.ROS2, whose `ros_plugins_timeout` is ignored."""

GROOT2_PORT = 1667

_PUBLISHES: Final = importlib.util.find_spec("zmq") is not None
"""Whether the trees are published for Groot 2 by default."""

_RECORDINGS: Final = Path(os.environ.get("ROS_HOME") or Path.home() / ".ros", "btcore", "recordings")
"""The folder in which the ends of failed trees are recorded by default."""

_DEFAULTS: Final[dict[str, object]] = {"record": str(_RECORDINGS), "record_on": "failure"}
"""Other defaults for options of providers."""

FIXED_PORT = "read-only, because viewers stay connected to this port between goals"


@click.command(
    "serve",
    cls=ProviderCommand,
    short_help="Serve trees as goals of an action.",
    context_settings={"default_map": {**_DEFAULTS, **({"publish": ("groot2",)} if _PUBLISHES else {})}},
)
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
@add_options(RunSettings, "seed")
@add_options(RosSettings)
@click.pass_context
def serve(
    ctx: click.Context,
    /,
    settings: GivenSettings,
    trees: tuple[Path, ...],
    action_name: str | None,
    tick_frequency: float | None,
    plugins: tuple[str, ...],
) -> int:
    """Serve the trees in TREES, XML files or folders, as the action btcpp_ros2_interfaces/ExecuteTree.

    The parameters of BehaviorTree.ROS2's TreeExecutionServer can be given by --ros-args:
    '-p tick_frequency:=50' or '--params-file FILE.yaml'. Ctrl-C ends the server.

    The end of each tree that fails is recorded in a folder (~/.ros/btcore/recordings, or that of --record);
    --record-on never turns this off.
    """
    arguments = [] if action_name is None else ["-p", f"action_name:={action_name}"]
    if tick_frequency is not None:
        arguments += ["-p", f"tick_frequency:={tick_frequency}"]
    ros, ros_robot = settings.of(RosSettings), settings.find(RosRobotSettings)
    with open_session(ros, ros_robot, NODE_NAME, arguments) as session:
        source = _TreeSource(ctx, session, trees, plugins)
        wanted = source.read_trees().check()
        uses_parameter = _set_port(settings, session)
        run = create_run(ctx, TreelessProgram("Waiting"), settings, resources=[session]).want(*wanted)
        with _explain_port(uses_parameter), run:
            robot = run.find(Robot)
            if robot is not None:
                session.drain_during(robot)
            with PublishedTreeServer(source, run) as server:
                _warn_about_misspelt_parameters(session)
                ids = ", ".join(server.tree_ids)
                session.node.get_logger().info(f"serving {ids} as the action {server.action_name}")
                run.run_until_signal(server.run, server.stop)
    return run.exit_code


class _TreeSource:
    """The files and the nodes of the server's trees, by the command's arguments or by ROS parameters.

    Args:
        ctx: The context of the command.
        session: The session, whose ROS node has the parameters.
        trees: The files and folders; if there are none, they are those of the parameter `behavior_trees`.
        plugins: The values of the option `--plugin`.
    """

    def __init__(
        self, ctx: click.Context, session: RosSession, trees: Sequence[Path], plugins: Sequence[str]
    ) -> None:
        self.session = session
        self._ctx = ctx
        self._trees = trees
        self._plugins = plugins
        self._further_plugins: Sequence[str] | None = None
        self._nodes: Registry  # of the installed libraries, of the options and of the parameter `plugins`

    def read_trees(self) -> LoadedTrees:
        """Return the trees as they are now.

        Raises:
            RosError: A parameter is not given, or names a package, folder or plugin that cannot be used.
            RegistrationError: A plugin cannot be loaded.
            TreeError: A file cannot be read or is not valid XML.
        """
        node = self.session.node
        further: Sequence[str] = declare_parameter(node, "plugins", [])
        if further != self._further_plugins:
            self._nodes = load_nodes(self._ctx, [*self._plugins, *_usable(further)])
            self._further_plugins = further
        files = self._trees or _find_files(declare_parameter(node, "behavior_trees", [], check=_find_files))
        return LoadedTrees(files, self._nodes)


class PublishedTreeServer(TreeServer):
    """A tree server whose trees are published by the providers of a run.

    Args:
        source: The files and the nodes.
        run: The run, whose resources the trees get.
    """

    def __init__(self, source: _TreeSource, run: Run) -> None:
        self._source = source
        self._run_of_trees = run
        super().__init__(source.session, (), resources=run.resources, clock=run.clock)

    def read_trees(self) -> LoadedTrees:
        """Return the trees of the source."""
        return self._source.read_trees()

    def on_tree_created(self, tree: Tree, payload: str) -> None:
        """Publish *tree* instead of the previous tree; clients stay connected."""
        self._run_of_trees.replace_tree(tree)


def _set_port(settings: GivenSettings, session: RosSession) -> bool:
    """Let Groot 2 use the port of the ROS parameter `groot2_port`, unless a port is given; return whether."""
    port = declare_parameter(session.node, "groot2_port", GROOT2_PORT, fixed=FIXED_PORT)
    if not _PUBLISHES:
        _warn(f"the trees are not published for Groot: {install_command('zmq')}")
    for given in [settings.of(struct) for struct in settings.classes]:
        if "groot2" in getattr(given, "publish", ()) and getattr(given, "port", None) is None:
            settings.replace(msgspec.structs.replace(given, port=port))
            return True
    return False


@contextmanager
def _explain_port(is_parameter: bool) -> Iterator[None]:
    """Return a context that explains how to choose another port, if a ROS parameter has chosen it."""
    try:
        yield
    except SettingsError as error:
        if not is_parameter or error.setting != "port":
            raise
        hint = "for a server that ros2 launch starts, set the ROS parameter groot2_port"
        raise SettingsError(f"{error}; {hint}") from error


def _warn_about_misspelt_parameters(session: RosSession) -> None:
    """Warn about given ROS parameters that nothing has declared and whose names are similar to ours."""
    given = getattr(session.node, "_parameter_overrides", {})  # rclpy has no public list of them
    for name in given:
        hint = did_you_mean(name, PARAMETERS)
        if hint and name not in PARAMETERS and not session.node.has_parameter(name):
            _warn(f"the ROS parameter {name} has no effect{hint}")


def _usable(plugins: Sequence[str]) -> Iterator[str]:
    """Yield the plugins of the ROS parameter that are not C++ libraries."""
    for plugin in plugins:
        if "/" in plugin and not plugin.endswith(".py"):
            _warn(
                f"the plugin '{plugin}' of the ROS parameter is ignored: C++ libraries cannot be loaded; "
                "give a Python module or file with the same nodes"
            )
        else:
            yield plugin


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
