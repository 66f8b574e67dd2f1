"""What the monitor brings to ``btcore run``: publishing, the viewer, and the recording.

The viewer and the recording are processes of their own that listen to what is published, so that
the robot's process never draws. Everything said here goes to stderr.
"""

import importlib.util
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, Final

import click

from btcore.tree import Tree
from monitor.commands import UsersMistake
from monitor.serve import Publisher, ServeError, serve
from monitor.wire.groot2 import DEFAULT_PORT

START_TIMEOUT: Final = 30.0
"""Seconds (wall clock) that a viewer or saver has to come up before the first tick."""

WRITE_TIMEOUT: Final = 60.0
"""Seconds (wall clock) that the saver has to finish its file after the last tick."""

VIEWER_GRACE: Final = 10.0
"""Seconds (wall clock) that the viewer has to catch up after the last tick."""

_SAY_AFTER: Final = 2.0


class MonitorExtension:
    """The options ``--publish``, ``--bind``, ``--port``, ``--monitor`` and ``--save`` of ``run``."""

    options: Sequence[click.Option] = (
        click.Option(
            ["--publish"],
            type=click.Choice(["groot2", "groot1"]),
            help="Let monitors in: Groot 2, and btcore's own. (groot1 isn't built yet.)",
        ),
        click.Option(
            ["--bind"],
            default="127.0.0.1",
            show_default=True,
            metavar="ADDRESS",
            help="Where to publish: an interface's address, or * for all.",
        ),
        click.Option(
            ["--port"],
            type=click.IntRange(0, 65533),
            help=f"The first of three ports; 0 takes free ones.  [default: {DEFAULT_PORT}; "
            "a free one for --monitor and --save alone]",
        ),
        click.Option(["--monitor"], is_flag=True, help="Start the viewer and show the run live."),
        click.Option(
            ["--save"],
            type=click.Path(dir_okay=False, path_type=Path),
            metavar="FILE.rrd",
            help="Record the run for the viewer (rerun).",
        ),
    )

    def __init__(self) -> None:
        self._publisher: Publisher | None = None

    def provide(self, settings: Mapping[str, Any], wanted: Sequence[type]) -> Sequence[object]:
        """Nothing for leaves; the options are checked here, before a world is built in vain."""
        if settings["publish"] == "groot1":
            raise UsersMistake(
                "--publish groot1 isn't built yet: --publish groot2 is, and btcore monitor reads it"
            )
        save: Path | None = settings["save"]
        if save is not None:
            _check_writable(save)
        if (save is not None or settings["monitor"]) and importlib.util.find_spec("rerun") is None:
            option = "--save" if save is not None else "--monitor"
            raise UsersMistake(f"{option} needs rerun, which isn't installed: pip install 'btcore[monitor]'")
        return ()

    def attach(
        self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]
    ) -> AbstractContextManager[None]:
        """Publish *tree* while the run lasts, as the options say."""
        return self._published(tree, resources, settings)

    def swap(self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]) -> None:
        """Publish *tree*, which has taken the place of the one before; who listens stays."""
        if self._publisher is not None:
            self._publisher.replace(tree, resources)

    def report(self) -> dict[str, object]:
        """Nothing: a run's results are the same with and without a monitor."""
        return {}

    @contextmanager
    def _published(
        self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]
    ) -> Iterator[None]:
        save: Path | None = settings["save"]
        view: bool = settings["monitor"]
        if settings["publish"] is None and save is None and not view:
            yield
            return
        port = settings["port"]
        if port is None:
            port = DEFAULT_PORT if settings["publish"] else 0
        try:
            publisher = serve(tree, groot2=port, bind=settings["bind"], resources=resources)
        except ServeError as error:
            raise UsersMistake(str(error)) from None
        with publisher:
            _say(f"publishing at {publisher.address} (btcore monitor {publisher.address})")
            listeners = []
            if save is not None:
                listeners.append(
                    _Listener(publisher, ["--save", str(save), "--no-view"], f"recording to {save}")
                )
            if view:
                listeners.append(_Listener(publisher, [], "the viewer"))
            try:
                _await_start(publisher, listeners)
                self._publisher = publisher
                yield
            finally:
                self._publisher = None
                publisher.finish()
                for listener in listeners:
                    listener.finish()


def _check_writable(save: Path) -> None:
    """Raise UsersMistake where no recording can be written; an existing file stays as it is."""
    if not save.resolve().parent.is_dir():
        raise UsersMistake(f"--save {save}: there is no folder {save.resolve().parent}")
    is_new = not save.exists()
    try:
        with save.open("ab"):
            pass
        if is_new:
            save.unlink()
    except OSError as fault:
        raise UsersMistake(f"--save {save}: it can't be written: {fault.strerror or fault}") from None


class _Listener:
    """A process of the monitor that listens to one run and ends with it."""

    def __init__(self, publisher: Publisher, options: list[str], name: str) -> None:
        self.name = name
        self.saves = "--save" in options
        self._publisher = publisher
        home = str(Path(__file__).parent.parent)
        path = os.pathsep.join([home, *filter(None, [os.environ.get("PYTHONPATH")])])
        # its own session: Ctrl-C ends the run, and the recording is still completed
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "monitor", publisher.address, "--until-end", *options],
            stdin=subprocess.DEVNULL,
            stdout=2,
            start_new_session=True,
            env=os.environ | {"PYTHONPATH": path},
        )

    def finish(self) -> None:
        """Wait, with a bound, until it has taken in everything."""
        limit = WRITE_TIMEOUT if self.saves else VIEWER_GRACE
        try:
            code = self._wait(limit)
        except subprocess.TimeoutExpired:
            _say(f"{self.name}: not finished {limit:g} s after the run, so its end may be missing")
            self.process.terminate()
            return
        except BaseException:
            self.process.terminate()
            raise
        if code and self.saves:
            _say(f"{self.name}: the monitor's process failed with exit code {code}")

    def _wait(self, limit: float) -> int:
        deadline = time.monotonic() + limit
        try:
            return self.process.wait(_SAY_AFTER)
        except subprocess.TimeoutExpired:
            _say(f"{self.name}: waiting until everything is taken in")
            return self.process.wait(max(0.0, deadline - time.monotonic()))


def _await_start(publisher: Publisher, listeners: list[_Listener]) -> None:
    """Return once every listener listens, so that the run begins before its eyes."""
    deadline = time.monotonic() + START_TIMEOUT
    while not publisher.wait_for_clients(len(listeners), 0.1):
        for listener in listeners:
            code = listener.process.poll()
            if code is not None:
                raise UsersMistake(
                    f"{listener.name}: the monitor's process ended at once, with exit code {code}"
                )
        if time.monotonic() > deadline:
            _say(f"the monitor is not listening after {START_TIMEOUT:g} s; the run begins without it")
            return


def _say(text: str) -> None:
    click.echo(f"monitor: {text}", err=True)
