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
from monitor.display import has_display
from monitor.serve import Publisher, ServeError, serve
from monitor.serve.ports import GROOT1_PORTS
from monitor.showing import UsersMistake, check_is_recording, check_writable
from monitor.wire.groot1 import BESIDE_GROOT2, PUBLISH_PORT
from monitor.wire.groot2 import DEFAULT_PORT

START_TIMEOUT: Final = 30.0
"""Seconds (wall clock) that a viewer or saver has to come up before the first tick."""

WRITE_TIMEOUT: Final = 60.0
"""Seconds (wall clock) that the saver has to finish its file after the last tick."""

VIEWER_GRACE: Final = 10.0
"""Seconds (wall clock) that the viewer has to catch up after the last tick."""

_SAY_AFTER: Final = 2.0
_APART: Final = BESIDE_GROOT2 - DEFAULT_PORT
"""How far Groot 1's ports are behind Groot 2's, if both are served: 1667 and 2666."""


class MonitorExtension:
    """The options ``--publish``, ``--bind``, ``--port``, ``--monitor`` and ``--save`` of ``run``."""

    options: Sequence[click.Option] = (
        click.Option(
            ["--publish"],
            type=click.Choice(["groot2", "groot1"]),
            multiple=True,
            help="Let monitors in: Groot 2 or Groot 1 (or both: say it twice), and btcore's own.",
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
            help=f"The first port; 0 takes free ones.  [default: {DEFAULT_PORT}, for Groot 1 {PUBLISH_PORT}; "
            f"Groot 1 beside Groot 2 is {_APART} further; a free one for --monitor and --save alone]",
        ),
        click.Option(
            ["--allow-control"],
            is_flag=True,
            help="Let whoever reaches the port set breakpoints and inject statuses (btcore hook).",
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

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object]
    ) -> Sequence[object]:
        """Nothing for leaves; the options are checked here, before a world is built in vain."""
        _ports(settings)
        if "groot1" in settings["publish"] and importlib.util.find_spec("flatbuffers") is None:
            raise UsersMistake(
                "--publish groot1 needs flatbuffers, which isn't installed: pip install 'btcore[monitor]'"
            )
        if settings["allow_control"] and "groot2" not in settings["publish"]:
            raise UsersMistake("--allow-control needs --publish groot2, by which a robot is controlled")
        save: Path | None = settings["save"]
        if save is not None:
            check_is_recording(save)
            check_writable("--save", save)
        if (save is not None or settings["monitor"]) and importlib.util.find_spec("rerun") is None:
            option = "--save" if save is not None else "--monitor"
            raise UsersMistake(f"{option} needs rerun, which isn't installed: pip install 'btcore[monitor]'")
        if settings["monitor"] and not has_display():
            raise UsersMistake(
                "--monitor: there is no display here. --save FILE.rrd records the run to look at it later; "
                "--publish groot2 lets a monitor in, also one in a browser: btcore monitor --serve-web"
            )
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
        if not settings["publish"] and save is None and not view:
            yield
            return
        port, groot1 = _ports(settings)
        try:
            publisher = serve(
                tree,
                groot2=port,
                groot1=groot1,
                bind=settings["bind"],
                resources=resources,
                allow_control=settings["allow_control"],
            )
        except ServeError as error:
            raise UsersMistake(str(error)) from None
        with publisher:
            _say(f"publishing at {publisher.address} (btcore monitor {publisher.address})")
            if publisher.groot1 is not None:
                why = f", since Groot 2 has {publisher.port}" if port is not None else ""
                _say(
                    f"Groot 1 finds it at publisher port {publisher.groot1} and server port "
                    f"{publisher.groot1 + 1}{why}"
                )
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


def _ports(settings: Mapping[str, Any]) -> tuple[int | None, int | None]:
    """The first ports for Groot 2 and for Groot 1; None: not for it. Raises UsersMistake."""
    publish, first = settings["publish"], settings["port"]
    if "groot1" not in publish:
        return (DEFAULT_PORT if publish else 0) if first is None else first, None
    if "groot2" not in publish:
        return None, PUBLISH_PORT if first is None else first
    port = DEFAULT_PORT if first is None else first
    groot1 = port + _APART if port else 0
    if groot1 + GROOT1_PORTS > 1 << 16:
        raise UsersMistake(
            f"--port {port} leaves no port for Groot 1, which is {_APART} further: choose one up to "
            f"{(1 << 16) - GROOT1_PORTS - _APART}"
        )
    return port, groot1


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
