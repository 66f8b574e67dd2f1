"""One run of ``btcore run``: what is attached, what ends it, and what takes a tree's place."""

import json
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple, cast

import click

from btcore.cli import paint
from btcore.cli.exit_codes import FAILURE, INTERRUPTED, RAISED
from btcore.cli.logs import Logs
from btcore.cli.outcome import Outcome
from btcore.cli.pace import Ending, Pace, Until
from btcore.cli.progress import Progress, summary
from btcore.cli.recipe import Recipe, Saves
from btcore.cli.remarks import remarks
from btcore.cli.resources import joined, tell_interrupted
from btcore.clock import NS_PER_S
from btcore.errors import BtcoreError, NodeRaised
from btcore.manifest import fits
from btcore.reload import successor
from btcore.status import Status
from btcore.tree import Tree
from btcore.xml.check import Examined


class Performed(NamedTuple):
    """What ended a run, its exit *code*, and what the extensions tell of it."""

    ending: Ending
    code: int
    figures: dict[str, object]


class Session:
    """The run of *tree* and, if *saves* are looked for, of those that take its place.

    *recipe* made it, of *resources*; *settings* are the options, and *brought* the extensions in the
    order in which they are attached. An extension may have a method ``swap(tree, resources, settings)``,
    which is called between two ticks, after the old tree was halted.
    """

    def __init__(
        self,
        tree: Tree,
        recipe: Recipe,
        settings: Mapping[str, Any],
        brought: Sequence[Any],
        resources: Sequence[object],
        saves: Saves | None = None,
    ) -> None:
        self.tree = tree
        self.recipe = recipe
        self.settings = settings
        self.brought = brought
        self.resources = resources
        self.saves = saves
        self.logs = Logs(settings["logs"])
        asked = settings["tree"]
        name = recipe.path.stem if asked is None else f"{recipe.path.stem}:{asked}"
        self.outcome = Outcome(name)
        self.reloads = 0
        self._told: NodeRaised | None = None

    def run(self) -> int:
        """Run to the end, say how it went, and return the exit code."""
        done = self.perform()
        outcome = self.outcome
        summary(self.tree, outcome.heading(self.tree, done.ending), outcome.results(self.tree), done.figures)
        if outcome.error is not None and outcome.error is not self._told:
            paint.error(str(outcome.error))
        if self.settings["as_json"]:
            click.echo(json.dumps(outcome.report(self.tree, done.figures), ensure_ascii=False))
        return done.code

    def perform(self) -> Performed:
        """Run to the end, and tell nobody but who is attached."""
        self.tree.count()
        with ExitStack() as attached:
            for extension in self.brought:
                attached.enter_context(extension.attach(self.tree, self.resources, self.settings))
            attached.callback(self.logs.close)
            self.logs.open(self.tree)
            ending = self._loop()
            if ending == "interrupted":
                tell_interrupted(self.brought)
        figures = joined([one.report() for one in self.brought])
        if self.saves is not None:
            figures = {"reloads": self.reloads, **figures}
        return Performed(ending, self._code(ending), figures)

    def _code(self, ending: Ending) -> int:
        if self.outcome.error is not None:
            return RAISED
        if ending == "interrupted":
            return INTERRUPTED
        return FAILURE if ending == "done" and self.outcome.status is Status.FAILURE else 0

    def _loop(self) -> Ending:
        """Tick until the end; the tree is halted afterwards, however it ended."""
        settings = self.settings
        duration = settings["duration"]
        progress = Progress(self.tree, self.outcome.name, duration)
        until = cast(Until, settings["until"])
        pace = Pace(
            self.tree, settings["rate"], duration, until, progress.ticked, self.saves, settings["fast"]
        )
        began = time.perf_counter()
        ending: Ending = "done"
        try:
            with pace.signals(), remarks(progress.console):
                ending = pace.run() if self.saves is None else self._follow(pace, progress)
            self.tree.halt()
        except NodeRaised as error:
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
            paint.warning(
                f"{left_out} left out, because the one before took longer than "
                f"{1000 / settings['rate']:g} ms; a lower --rate fits this tree"
            )
        return ending

    def _follow(self, pace: Pace, progress: Progress) -> Ending:
        """Tick one tree after the other; when one is done, or raised, wait for the next save."""
        resting = False
        while True:
            try:
                ending = pace.rest() if resting else pace.run()
            except NodeRaised as error:
                self.outcome.error = self._told = error
                with progress.aside():
                    paint.error(str(error))
                ending = "done"
            if ending == "done":
                resting = True
                raised = self.outcome.error is not None
                progress.rests(None if raised else pace.status, self.recipe.path.name)
            elif ending == "saved":
                with progress.aside():
                    if self._replaced():
                        pace.tree = self.tree
                        progress.follow(self.tree)
                        resting = False
            else:
                return ending

    def _replaced(self) -> bool:
        """Let the tree of the saved file take the place of the old one; if it is broken, tell why."""
        examined: Examined | None = None
        try:
            examined, nodes = self.recipe.read()
            made = successor(self.tree, examined, self.resources, nodes)
        except BtcoreError as error:
            if examined is not None:
                self._note_resources(error, examined)
            paint.fault(error)
            goes_on = "goes on" if self.tree.status is Status.RUNNING else "stays"
            paint.warning(f"{self.recipe.path.name} is broken: the tree from before {goes_on}")
            return False
        paint.diagnostics(examined.faults.warnings)
        self._exchange(made)
        paint.said("reloaded", str(self.recipe.path))
        return True

    def _note_resources(self, error: BtcoreError, examined: Examined) -> None:
        wanted = [kind for manifest in examined.used() for kind in manifest.wanted]
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
        except NodeRaised as error:
            paint.error(str(error))
        made.count()
        self.tree = made
        self.outcome.error = None
        self.reloads += 1
        self.logs.open_next(made)
        for extension in self.brought:
            swap = getattr(extension, "swap", None)
            if swap is not None:
                swap(made, self.resources, self.settings)
