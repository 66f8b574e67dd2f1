"""`btcore run`: run a tree, with the resources that extensions from other packages provide."""

import math
import random
from collections.abc import Mapping, Sequence
from typing import Any, cast

import click

from btcore.cli import initial_blackboard, node_libraries, stub_results, substitute, terminal
from btcore.cli.completion import complete_tree
from btcore.cli.extension import gather_resources
from btcore.cli.extension_options import DeferringRunCommand, load_needed_extensions, warn_unused_options
from btcore.cli.run_logs import log_option
from btcore.cli.run_session import RunSession
from btcore.cli.tree_source import STDIN, SaveWatcher, TreeSource, find_source, tree_options
from btcore.clock import Clock, SimClock, SystemClock
from btcore.diagnostic_codes import NODE_NOT_CREATED
from btcore.entry_points import names_by_remedy
from btcore.errors import TreeError
from btcore.loading.instantiate import instantiate
from btcore.run_extension import RunExtension
from btcore.xml.models.stubs import StubResults
from btcore.xml.plan.plan import Plans


class FiniteRange(click.FloatRange):
    """A range of finite numbers: infinity and NaN are errors."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert *value* to a finite number in the range. Any other value is a usage error.

        Args:
            value: The text of the option.
            param: The option.
            ctx: The context of the command.

        Returns:
            The number.
        """
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


@click.command(cls=DeferringRunCommand, short_help="Run a tree until it ends.")
@click.argument("source", metavar="TREE", shell_complete=complete_tree)
@tree_options
@stub_results.stub_results_option
@substitute.substitute_option
@initial_blackboard.set_option
@click.option(
    "--rate",
    type=FiniteRange(0, 10_000, min_open=True),
    default=10.0,
    show_default=True,
    metavar="HZ",
    help="Ticks per second.",
)
@click.option(
    "--duration",
    type=FiniteRange(0, min_open=True),
    metavar="S",
    help="End the run after S seconds of the tree's clock.",
)
@click.option(
    "--tick-limit",
    type=FiniteRange(0, min_open=True),
    metavar="S",
    help="Raise an error if a tick repeats nodes without a pause for more than S seconds of real time.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    metavar="N",
    help="Seed of the random numbers; the same seed reproduces the same run.",
)
@click.option("--fast", is_flag=True, help="Use simulated time and run as fast as possible.")
@click.option(
    "--until",
    type=click.Choice(["done", "success", "failure", "never"]),
    default="done",
    show_default=True,
    help="The result of the tree that ends the run; after any other result the tree is ticked again.",
)
@click.option(
    "--watch",
    is_flag=True,
    help="Reload the tree whenever its file is saved, and keep the blackboard. A file with errors is "
    "reported, and the previous tree continues. After the tree has ended, wait for the next save, until "
    "--duration or Ctrl-C ends the run.",
)
@log_option
@click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="Print the results as a JSON object on the last line of stdout (with --watch, of the last tree).",
)
@click.pass_context
def run(ctx: click.Context, /, **settings: Any) -> int:
    """Run TREE until it ends.

    TREE is an XML file, - for stdin, or the name of a tree that is bundled with btcore, such as bumpgo. The
    summary is printed on stderr.

    \b
    Exit codes:
      0    the tree ended in SUCCESS or SKIPPED, or --duration ended the run
      1    the tree ended in FAILURE
      2    an error in the tree or on the command line
      3    a leaf raised an exception, or a tick exceeded --tick-limit
      4    a log or a recording is incomplete, for example because the disk is full
      130  interrupted by Ctrl-C
      143  terminated by SIGTERM
    """
    return create_session(ctx, settings).run_and_report()


def create_session(
    ctx: click.Context,
    settings: Mapping[str, Any],
    extra_extensions: Sequence[RunExtension] = (),
    installed_nodes: node_libraries.NodeLibraries | None = None,
) -> RunSession:
    """Return a run, before its first tick.

    Args:
        extra_extensions: Extensions besides those of the installed packages; they are attached last.
        installed_nodes: The installed nodes, for a process that loads them once for many runs. They are
            copied, not changed.

    Raises:
        click.ClickException: An option has an invalid value.
        TreeError: The tree has an error, or lacks a resource.
        RegistrationError: A node library cannot be loaded.
        ExtensionError: An installed extension cannot be used.
    """
    # The watcher looks at the files before they are read: a save in between is not missed.
    save_watcher = None
    if settings["watch"]:
        file = find_source(settings["source"])
        if file == STDIN:
            raise click.UsageError("--watch needs a file: a tree on stdin cannot be saved again.")
        save_watcher = SaveWatcher(file, settings["confined"])
    source, plans = read_source_and_plans(settings, installed_nodes)
    # Determined before the tree is built: an extension such as a simulator provides only what is needed.
    wanted = plans.required_resources()
    (installed_extensions, unavailable), settings = load_needed_extensions(ctx, settings, wanted)
    resources, extensions, without_resources = gather_resources(installed_extensions, settings, wanted)
    clock = choose_clock(resources, settings["fast"])
    resources += [random.Random(settings["seed"]), StubResults(settings["stub_letters"])]
    try:
        tree = instantiate(plans, resources, clock=clock, tick_limit=settings["tick_limit"])
    except TreeError as error:
        for remedy, names in names_by_remedy(unavailable if wanted else ()).items():
            error.add_note(f"extensions that may provide it cannot be loaded ({names}): {remedy}")
        missing_kinds = [
            kind for kind in wanted if not any(isinstance(resource, kind) for resource in resources)
        ]
        own = any(getattr(kind, "__module__", "builtins") != "builtins" for kind in missing_kinds)
        if own and any(diagnostic.code == NODE_NOT_CREATED for diagnostic in error.diagnostics):
            error.add_note(
                "`btcore run` does not create objects of your own classes: derive the class from "
                "btcore.TreeState, or write an extension that provides the object: see 'Your robot'"
            )
        raise
    initial_blackboard.write(tree, settings["set"], plans)
    terminal.print_diagnostics(plans.diagnostics.warnings)
    substitute.warn_unused_rules(tree)
    warn_unused_options(ctx, without_resources)
    return RunSession(tree, source, settings, [*extensions, *extra_extensions], resources, save_watcher)


def read_source_and_plans(
    settings: Mapping[str, Any], installed_nodes: node_libraries.NodeLibraries | None = None
) -> tuple[TreeSource, Plans]:
    """Read and check the document of a run's tree, before extensions create resources such as a simulator.

    Args:
        installed_nodes: The installed nodes, or None to load them.

    Returns:
        The source of the tree, and its plans.

    Raises:
        click.UsageError: An option has an invalid value.
        TreeError: The document has an error.
        RegistrationError: A node library cannot be loaded.
    """
    path = find_source(settings["source"])
    if installed_nodes is None or settings["plugins"]:
        # Models and rules may name nodes of the installed libraries. Also, they would be lost when
        # `NodeLibraries.load_for` loads what is missing, because it begins anew.
        partial = not settings["models"] and not settings["substitute"]
        libraries = node_libraries.load_libraries(settings["plugins"], partial=partial)
    else:
        libraries = node_libraries.NodeLibraries(installed_nodes.nodes.copy(), installed_nodes.unavailable)
    confined = settings["confined"]
    libraries.add_models(settings["models"], confined)
    source = TreeSource(path, settings["tree"], libraries, settings["format"], confined)
    substitute.add_rules(libraries.nodes, settings["substitute"])
    plans = source.read_plans()
    stub_results.check(settings["stub_letters"], plans)
    return source, plans


def choose_clock(resources: Sequence[object], fast: bool) -> Clock:
    """Return the clock for a run: the attribute `clock` of the first resource that has it, or a new clock.

    The extensions of a run agree on this attribute, see `RunExtension.provide`: the robot of a simulated
    world has the clock of the world. `btcore.load` receives arbitrary objects, whose attribute `clock` may
    be anything. It therefore uses only a resource that is a clock itself.

    Args:
        resources: The resources of the run.
        fast: Whether a new clock is simulated instead of real.
    """
    for resource in resources:
        clock = getattr(resource, "clock", None)
        if clock is not None:
            return cast(Clock, clock)
    return SimClock() if fast else SystemClock()
