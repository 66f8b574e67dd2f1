"""``btcore run``: a tree from its file to its end, in the world that other packages bring."""

import json
import random
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final, cast

import click
from rich.text import Text

from btcore.cli import extensions, library, paint, trees
from btcore.cli.pace import Ending, Pace, Until
from btcore.cli.progress import Progress, summary
from btcore.clock import NS_PER_S, Clock, SimClock, SystemClock
from btcore.errors import NodeRaised, TreeError
from btcore.status import Status
from btcore.tree import Tree
from btcore.xml.build import build
from btcore.xml.check import examine
from btcore.xml.source import read_file

RESOURCES: Final = "btcore.resources"
_META: Final = "btcore.cli.run.extensions"

FAILURE: Final = 1
RAISED: Final = 3
INTERRUPTED: Final = 130


class Run(click.Command):
    """The command, with the options of the packages that bring worlds, robots and monitors."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Its own options, then those of the extensions, then ``--help``."""
        own = super().get_params(ctx)
        brought = [option for extension in _extensions(ctx)[0] for option in extension.options]
        return [*own[:-1], *brought, own[-1]]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """As click does; an option that an absent package may bring is explained."""
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            missing = _extensions(ctx)[1]
            if not missing:
                raise
            text = error.format_message().rstrip(".")
            why = "; ".join(f"'{one.name}', because {one.remedy}" for one in missing)
            raise click.UsageError(f"{text}. Or a package brings it that isn't there: {why}", ctx) from error


def _extensions(ctx: click.Context) -> tuple[list[Any], list[extensions.Missing]]:
    """The extensions of this run, made once, and those that can't be."""
    if _META not in ctx.meta:
        found, missing = extensions.load(RESOURCES)
        ctx.meta[_META] = ([one.value() for one in found], missing)
    made: tuple[list[Any], list[extensions.Missing]] = ctx.meta[_META]
    return made


@click.command(cls=Run, short_help="Run a tree, until it is done.")
@click.argument("source", metavar="TREE")
@click.option("--tree", metavar="ID", help="Which of the file's trees; default: its main one.")
@library.plugin_option
@click.option(
    "--rate",
    type=click.FloatRange(0, 10_000, min_open=True),
    default=10.0,
    show_default=True,
    help="Ticks per second.",
)
@click.option(
    "--duration",
    type=click.FloatRange(0, min_open=True),
    metavar="S",
    help="End after so many seconds of the tree's clock.",
)
@click.option(
    "--seed",
    type=int,
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
@click.option("--json", "as_json", is_flag=True, help="One JSON object as the last line of stdout.")
@click.pass_context
def run(ctx: click.Context, /, **settings: Any) -> int:
    """Run TREE, a file or the name of a tree that comes with btcore (say, bumpgo).

    Exits with 0 when it ends in SUCCESS or SKIPPED or by --duration, 1 for FAILURE, 2 for a
    mistake in the tree or on the command line, 3 when a leaf raised, 130 when interrupted.
    """
    path = trees.find(settings["source"])
    found = library.library(settings["plugins"])
    brought, missing = _extensions(ctx)
    with found.explaining():
        document = read_file(path)
        examined = examine(document, found.nodes, settings["tree"])
        examined.faults.raise_errors()
        wanted = [kind for manifest in examined.used() for kind in manifest.wanted]
        provided = [(one, list(one.provide(settings, wanted))) for one in brought]
        resources = [thing for _, things in provided for thing in things]
        clock = _clock(resources, settings["fast"])
        resources.append(random.Random(settings["seed"]))
        try:
            tree = build(document, found.nodes, tree=settings["tree"], resources=resources, clock=clock)
        except TreeError as error:
            for one in missing if wanted else ():
                error.add_note(f"'{one.name}' isn't there, and may bring it: {one.remedy}")
            raise
    paint.diagnostics(examined.faults.warnings)
    # Who brought a world is attached first and leaves last, so that the others see it to its end.
    brought = [one for one, _ in sorted(provided, key=lambda pair: not pair[1])]
    return Session(tree, path, settings, brought, resources).run()


def _clock(resources: Sequence[object], fast: bool) -> Clock:
    """The clock of the world if there is one, else simulated or real time."""
    for resource in resources:
        clock = getattr(resource, "clock", None)
        if clock is not None:
            return cast(Clock, clock)
    return SimClock() if fast else SystemClock()


class Session:
    """One run of one tree: what is attached, how it ends, and what is said of it."""

    def __init__(
        self,
        tree: Tree,
        path: Path,
        settings: Mapping[str, Any],
        brought: Sequence[Any],
        resources: Sequence[object],
    ) -> None:
        self.tree = tree
        self.name = path.stem if settings["tree"] is None else f"{path.stem}:{settings['tree']}"
        self.settings = settings
        self.brought = brought
        self.resources = resources
        self.error: NodeRaised | None = None
        self.elapsed = 0.0
        self.wall = 0.0
        self.status = Status.IDLE

    def run(self) -> int:
        """Run to the end, say how it went, and return the exit code."""
        self.tree.count()
        with ExitStack() as attached:
            for extension in self.brought:
                attached.enter_context(extension.attach(self.tree, self.resources, self.settings))
            ending = self._loop()
        results = self._results()
        figures = {key: value for one in self.brought for key, value in one.report().items()}
        summary(self.tree, self._heading(ending), results, figures)
        if self.error is not None:
            paint.error(str(self.error))
        if self.settings["as_json"]:
            click.echo(json.dumps(self._report(results, figures), ensure_ascii=False))
        if self.error is not None:
            return RAISED
        if ending == "interrupted":
            return INTERRUPTED
        return FAILURE if ending == "done" and self.status is Status.FAILURE else 0

    def _loop(self) -> Ending:
        """Tick until the end; the tree is halted afterwards, however it ended."""
        settings = self.settings
        progress = Progress(self.tree, self.name, settings["duration"])
        until = cast(Until, settings["until"])
        pace = Pace(self.tree, settings["rate"], settings["duration"], until, progress.ticked)
        began = time.perf_counter()
        ending: Ending = "done"
        try:
            ending = pace.run()
            self.tree.halt()
        except NodeRaised as error:
            self.error = error
        except BaseException:
            self.tree.halt()
            raise
        finally:
            self.status = pace.status
            self.elapsed = pace.elapsed / NS_PER_S
            self.wall = time.perf_counter() - began
            progress.close()
        if pace.late:
            paint.warning(
                f"{pace.late} ticks were left out, because the one before took longer than "
                f"{1000 / settings['rate']:g} ms; a lower --rate fits this tree"
            )
        return ending

    def _results(self) -> dict[str, dict[str, object]]:
        """What each node did, by full path; where two paths are equal ``#<uid>`` tells them apart."""
        return {
            key: {
                "id": node.id,
                "ticks": tally.ticks,
                "success": tally.success,
                "failure": tally.failure,
                "skipped": tally.skipped,
                "halted": tally.halted,
            }
            for key, node in self.tree.keys().items()
            for tally in (node.count(),)
        }

    @property
    def _factor(self) -> float:
        return self.elapsed / self.wall if self.wall > 0 else 0.0

    def _heading(self, ending: Ending) -> Text:
        """How it ended, in one line."""
        raised = Text("✘ RAISED", style="bold red")
        result = paint.status(self.status) if self.error is None else raised
        how = {"done": "", "duration": ", by --duration", "interrupted": ", interrupted"}[ending]
        took = f"{self.elapsed:.1f} s, {self.tree.ticks} ticks, ×{self._factor:.1f} real time{how}"
        return Text.assemble(result, "  ", (self.name, "bold"), "  ", took)

    def _report(self, results: Mapping[str, object], figures: Mapping[str, object]) -> dict[str, object]:
        """The object of ``--json``."""
        report: dict[str, object] = {
            "status": self.status.name,
            "ticks": self.tree.ticks,
            "time_s": self.elapsed,
            "real_time_factor": round(self._factor, 3),
            "nodes": results,
            **figures,
        }
        if self.error is not None:
            report["error"] = {
                "node": self.error.path,
                "id": self.error.node_id,
                "while": self.error.doing,
                "exception": type(self.error.cause).__name__,
                "message": str(self.error.cause),
            }
        return report
