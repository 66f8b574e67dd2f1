"""``btcore run``: a tree from its file to its end, in the world that other packages bring."""

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, cast

import click
from click.core import ParameterSource

from btcore.cli import (
    initial_blackboard,
    node_libraries,
    node_models,
    stub_plans,
    substitute,
    terminal,
    trees,
)
from btcore.cli.extension import gather_resources, load_extensions
from btcore.cli.run_logs import log_option
from btcore.cli.run_session import RunSession
from btcore.cli.tree_source import CheckedSource, SaveWatcher, TreeSource
from btcore.clock import Clock, SimClock, SystemClock
from btcore.errors import TreeError
from btcore.run_extension import RunExtension
from btcore.suggestions import join_names
from btcore.xml.build import TreeInstantiator
from btcore.xml.models.stand_ins import StubPlans


class FiniteRange(click.FloatRange):
    """A range of numbers without "nan"."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a number that can be counted to.", param, ctx)
        return number


class RunCommand(click.Command):
    """The command, with the options of the packages that bring worlds, robots and monitors."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Its own options, then those of the extensions, then ``--help``."""
        own = super().get_params(ctx)
        added = [option for one in load_extensions(ctx).extensions for option in one.options]
        return [*own[:-1], *added, own[-1]]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """As click does; an option that an absent package may bring is explained."""
        with explain_missing_options(ctx):
            return super().parse_args(ctx, args)


@contextmanager
def explain_missing_options(ctx: click.Context) -> Iterator[None]:
    """Within it, of an option that there isn't it is told that an absent package may bring it."""
    try:
        yield
    except click.NoSuchOption as error:
        missing = load_extensions(ctx).missing
        if not missing:
            raise
        text = error.format_message().rstrip(".")
        why = "; ".join(f"'{one.name}', because {one.remedy}" for one in missing)
        raise click.UsageError(f"{text}. Or a package brings it that isn't there: {why}", ctx) from error


@click.command(cls=RunCommand, short_help="Run a tree, until it is done.")
@click.argument("source", metavar="TREE")
@trees.tree_option
@trees.format_option
@node_libraries.plugin_option
@node_models.model_option
@stub_plans.plan_option
@substitute.substitute_option
@initial_blackboard.set_option
@click.option(
    "--rate",
    type=FiniteRange(0, 10_000, min_open=True),
    default=10.0,
    show_default=True,
    help="Ticks per second.",
)
@click.option(
    "--duration",
    type=FiniteRange(0, min_open=True),
    metavar="S",
    help="End after so many seconds of the tree's clock.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="What chance is drawn from; the same seed gives the same run.",
)
@click.option("--fast", is_flag=True, help="Simulated time, as fast as it goes, instead of real time.")
@click.option(
    "--until",
    type=click.Choice(["done", "success", "failure", "never"]),
    default="done",
    show_default=True,
    help="What result ends the run; after any other the tree is ticked on.",
)
@click.option(
    "--watch",
    is_flag=True,
    help="When the XML is saved, go on with the new tree and the same blackboard; one that is broken is "
    "reported, and the old one goes on. A tree that is done, or raised, waits for the next save: "
    "--duration or Ctrl-C ends the run.",
)
@log_option
@click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="One JSON object as the last line of stdout; with --watch, of the last tree.",
)
@click.pass_context
def run(ctx: click.Context, /, **settings: Any) -> int:
    """Run TREE, a file or the name of a tree that comes with btcore (say, bumpgo).

    Exits with 0 when it ends in SUCCESS or SKIPPED or by --duration, 1 for FAILURE, 2 for a
    mistake in the tree or on the command line, 3 when a leaf raised, 130 when interrupted.
    """
    return create_session(ctx, settings).run()


def create_session(
    ctx: click.Context,
    settings: Mapping[str, Any],
    joining: Sequence[RunExtension] = (),
    installed: node_libraries.NodeLibraries | None = None,
) -> RunSession:
    """The run that the command's *settings* ask for, before its first tick.

    Further extensions may be *joining* those of the packages: they are attached last. A process with many
    runs finds the nodes *installed* once: they are left as they are. Raises what says that
    it can't be had: click.ClickException, TreeError, RegistrationError.
    """
    saves = SaveWatcher(trees.find(settings["source"])) if settings["watch"] else None
    recipe, (examined, nodes) = read_tree_source(settings, installed)
    installed_extensions, missing = load_extensions(ctx)
    wanted = [kind for manifest in examined.used_manifests() for kind in manifest.required_resources]
    resources, extensions, idle = gather_resources(installed_extensions, settings, wanted)
    clock = clock_of(resources, settings["fast"])
    resources += [random.Random(settings["seed"]), StubPlans(settings["plans"])]
    try:
        tree = TreeInstantiator(examined, nodes, None, resources, clock).instantiate()
    except TreeError as error:
        for one in missing if wanted else ():
            error.add_note(f"'{one.name}' isn't there, and may bring it: {one.remedy}")
        raise
    initial_blackboard.write(tree, settings["entries"])
    terminal.print_diagnostics(examined.diagnostics.warnings)
    substitute.warn_unused_rules(tree)
    _warn_unused_options(ctx, idle)
    return RunSession(tree, recipe, settings, [*extensions, *joining], resources, saves)


def read_tree_source(
    settings: Mapping[str, Any], installed: node_libraries.NodeLibraries | None = None
) -> tuple[TreeSource, CheckedSource]:
    """How the tree of the command's *settings* is made, and its document, checked, before any world is."""
    path = trees.find(settings["source"])
    if installed is None or settings["plugins"]:
        found = node_libraries.load_libraries(settings["plugins"])
    else:
        found = node_libraries.NodeLibraries(installed.nodes.copy(), installed.absent)
    recipe = TreeSource(path, settings["tree"], found, settings["models"], settings["format"])
    substitute.add_rules(found.nodes, settings["substitutes"])
    reading = recipe.read()
    stub_plans.check(settings["plans"], reading.examined)
    return recipe, reading


def _warn_unused_options(ctx: click.Context, idle: Sequence[RunExtension]) -> None:
    """Warn of options on the command line whose extension is *idle*, as no leaf of the tree uses it."""
    for extension in idle:
        given = [
            option.opts[0]
            for option in extension.options
            if ctx.get_parameter_source(option.name or "") is ParameterSource.COMMANDLINE
        ]
        if extension.used_by is not None and given:
            do = "does" if len(given) == 1 else "do"
            terminal.print_warning(
                f"{join_names(given)} {do} nothing here: the tree has no {extension.used_by}"
            )


def clock_of(resources: Sequence[object], fast: bool) -> Clock:
    """The clock of the world if there is one, else simulated or real time."""
    for resource in resources:
        clock = getattr(resource, "clock", None)
        if clock is not None:
            return cast(Clock, clock)
    return SimClock() if fast else SystemClock()
