"""One run of ``btcore run``: what is attached, what ends it, and what takes a tree's place."""

import json
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple, cast

import click

from btcore.cli import terminal
from btcore.cli.exit_codes import ExitCode
from btcore.cli.extension import merge_reports
from btcore.cli.leaf_logging import log_to_console
from btcore.cli.progress import Progress, print_summary
from btcore.cli.run_logs import Logs
from btcore.cli.run_report import RunReport
from btcore.cli.tick_loop import EndReason, TickLoop, Until
from btcore.cli.tree_source import SaveWatcher, TreeSource
from btcore.clock import NS_PER_S
from btcore.errors import BtcoreError, NodeExecutionError
from btcore.loading.hot_reload import rebuild_tree
from btcore.registry.manifest import fits
from btcore.run_extension import RunExtension
from btcore.status import Status
from btcore.tree.tree import Tree
from btcore.xml.plan.document_checks import DocumentAnalysis


class SessionResult(NamedTuple):
    """What ended a run, its exit *code*, and what the extensions report."""

    ending: EndReason
    code: ExitCode
    figures: dict[str, object]


class RunSession:
    """The run of *tree* and, if *saves* are looked for, of those that take its place.

    *recipe* made it, of *resources*; *settings* are the options, and *extensions* the extensions in the
    order in which they are attached.
    """

    def __init__(
        self,
        tree: Tree,
        recipe: TreeSource,
        settings: Mapping[str, Any],
        extensions: Sequence[RunExtension],
        resources: Sequence[object],
        saves: SaveWatcher | None = None,
    ) -> None:
        self.tree = tree
        self.recipe = recipe
        self.settings = settings
        self.extensions = extensions
        self.resources = resources
        self.saves = saves
        self.logs = Logs(settings["logs"])
        asked = settings["tree"]
        name = recipe.path.stem if asked is None else f"{recipe.path.stem}:{asked}"
        self.outcome = RunReport(name)
        self.reloads = 0
        self._told: NodeExecutionError | None = None

    def run(self) -> int:
        """Run to the end, say how it went, and return the exit code."""
        done = self.execute()
        outcome = self.outcome
        print_summary(
            self.tree, outcome.heading(self.tree, done.ending), outcome.results(self.tree), done.figures
        )
        if outcome.error is not None and outcome.error is not self._told:
            terminal.print_error(str(outcome.error))
        if self.settings["as_json"]:
            click.echo(json.dumps(outcome.report(self.tree, done.figures), ensure_ascii=False))
        return done.code

    def execute(self) -> SessionResult:
        """Run to the end, without printing a summary: notify attached extensions only."""
        self.tree.count_ticks()
        with ExitStack() as attached:
            for extension in self.extensions:
                attached.enter_context(extension.attach(self.tree, self.resources, self.settings))
            attached.callback(self.logs.close)
            self.logs.open(self.tree)
            ending = self._loop()
            if ending == "interrupted":
                for extension in self.extensions:
                    extension.on_interrupt()
        figures = merge_reports(self.extensions)
        if self.saves is not None:
            figures = {"reloads": self.reloads, **figures}
        return SessionResult(ending, self._code(ending), figures)

    def _code(self, ending: EndReason) -> ExitCode:
        if self.outcome.error is not None:
            return ExitCode.LEAF_ERROR
        if ending == "interrupted":
            return ExitCode.INTERRUPTED
        failed = ending == "done" and self.outcome.status is Status.FAILURE
        return ExitCode.FAILURE if failed else ExitCode.SUCCESS

    def _loop(self) -> EndReason:
        """Tick until the end; the tree is halted afterwards, however it ended."""
        settings = self.settings
        duration = settings["duration"]
        progress = Progress(self.tree, self.outcome.name, duration)
        until = cast(Until, settings["until"])
        pace = TickLoop(
            self.tree, settings["rate"], duration, until, progress.ticked, self.saves, settings["fast"]
        )
        began = time.perf_counter()
        ending: EndReason = "done"
        try:
            with pace.signals(), log_to_console(progress.console):
                ending = pace.run() if self.saves is None else self._follow(pace, progress)
            self.tree.halt()
        except NodeExecutionError as error:
            self.outcome.error = error
        except BaseException:
            self.tree.halt()
            raise
        finally:
            self.outcome.status = pace.status if self.outcome.error is None else Status.IDLE
            self.outcome.elapsed = pace.elapsed / NS_PER_S
            self.outcome.wall = time.perf_counter() - began
            progress.close()
        if pace.late:
            left_out = "1 tick was" if pace.late == 1 else f"{pace.late} ticks were"
            terminal.print_warning(
                f"{left_out} left out, because the one before took longer than "
                f"{1000 / settings['rate']:g} ms; a lower --rate fits this tree"
            )
        return ending

    def _follow(self, pace: TickLoop, progress: Progress) -> EndReason:
        """Tick one tree after the other; when one is done, or raised, wait for the next save."""
        resting = False
        while True:
            try:
                ending = pace.wait_for_save() if resting else pace.run()
            except NodeExecutionError as error:
                self.outcome.error = self._told = error
                with progress.suspend():
                    terminal.print_error(str(error))
                ending = "done"
            if ending == "done":
                resting = True
                raised = self.outcome.error is not None
                progress.show_waiting(None if raised else pace.status, self.recipe.path.name)
            elif ending == "saved":
                with progress.suspend():
                    if self._replaced():
                        pace.tree = self.tree
                        progress.follow(self.tree)
                        resting = False
            else:
                return ending

    def _replaced(self) -> bool:
        """Let the tree of the saved file take the place of the old one; if it is broken, tell why."""
        examined: DocumentAnalysis | None = None
        try:
            examined, nodes = self.recipe.read()
            made = rebuild_tree(self.tree, examined, self.resources, nodes)
        except BtcoreError as error:
            if examined is not None:
                self._note_resources(error, examined)
            terminal.print_btcore_error(error)
            goes_on = "goes on" if self.tree.status is Status.RUNNING else "stays"
            terminal.print_warning(f"{self.recipe.path.name} is broken: the tree from before {goes_on}")
            return False
        terminal.print_diagnostics(examined.diagnostics.warnings)
        self._exchange(made)
        terminal.print_labelled("reloaded", str(self.recipe.path))
        return True

    def _note_resources(self, error: BtcoreError, examined: DocumentAnalysis) -> None:
        wanted = [kind for manifest in examined.used_manifests() for kind in manifest.required_resources]
        try:
            all_there = all(any(fits(one, kind) for one in self.resources) for kind in wanted)
        except TypeError:
            return  # a type that can't be asked for, which is the very error
        if not all_there:
            error.add_note("what leaves ask for is made when a run begins: begin another one for this tree")

    def _exchange(self, made: Tree) -> None:
        """Halt the tree, and let everybody go over to *made*."""
        try:
            self.tree.halt()
        except NodeExecutionError as error:
            terminal.print_error(str(error))
        made.count_ticks()
        self.tree = made
        self.outcome.error = None
        self.reloads += 1
        self.logs.open_next(made)
        for extension in self.extensions:
            extension.replace_tree(made, self.resources, self.settings)
