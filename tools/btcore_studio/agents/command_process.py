"""Run a command of btcore for an agent in a process with limits for time, memory and output."""

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final, NamedTuple

import anyio
import anyio.to_thread
from anyio.abc import ByteReceiveStream, Process

from btcore import bundled_trees
from btcore.entry_points import LIMIT_VARIABLE
from btcore.input_files import SIZE_VARIABLE
from btcore.signals import NEW_PROCESS_GROUP
from btcore_studio.agents import limited_command
from btcore_studio.served_folder import RefusedError, ServedFolder

MAX_OUTPUT: Final = 16_000_000
"""The maximum size of what a command prints (bytes)."""
MAX_FILE: Final = 64_000_000
"""The maximum size of each file that a command reads or writes (bytes)."""
MEMORY: Final = 2_000_000_000
"""The maximum size of the data of each process (bytes)."""
PROCESSES: Final = 2
"""The number of commands that run at the same time; further commands wait."""
MAX_WAITING: Final = 20
"""The number of commands that may wait."""
SIMULATION: Final = (
    *("btdb", "btrec.txt", "db3", "fbl", "json", "mcap", "nav2"),
    *("prove", "recorder", "robot_nodes", "stats", "sweep", "why"),
    *("simulator", "world_map", "world_places", "map_file", "waypoints"),
    *("navigation", "navigator", "navigation_servers", "exploration", "head_tracker", "object_locator"),
)
"""The entry points of btcore that are used: logs, recordings, nodes, and a robot in a simulated world."""

_PATIENCE: Final = 0.75
"""The part of the time limit after which a command is interrupted."""
_KEPT: Final = ("PATH", "PYTHONPATH", "LANG", "LC_ALL", "SYSTEMROOT", "BTCORE_PURE", "BTCORE_COMPILED")


class Finished(NamedTuple):
    """The exit code and the output of a command.

    Attributes:
        incomplete: What to do about an output that is incomplete, because the time of the command has ended.
    """

    code: int
    stdout: str
    stderr: str
    incomplete: str = ""


class CommandRunner:
    """Runs commands that can read the served folder.

    Args:
        time_limit: The time (s) after which a command is killed with all processes that it started. Before,
            it is interrupted, so that it prints what it has.
        plugins: Node libraries that the user permits, as values of `--plugin`.
    """

    def __init__(self, folder: ServedFolder, time_limit: float, plugins: Sequence[str] = ()) -> None:
        self.folder = folder
        self.time_limit = time_limit
        self.plugins = [
            f"--plugin={Path(plugin).resolve() if plugin.endswith('.py') else plugin}" for plugin in plugins
        ]
        self.scratch = Path(tempfile.mkdtemp(prefix="btcore-mcp-")).resolve()
        self._slots = anyio.Semaphore(PROCESSES)

    def close(self) -> None:
        """Remove the files of all commands."""
        shutil.rmtree(self.scratch, ignore_errors=True)

    @contextmanager
    def temporary_folder(self) -> Iterator[Path]:
        """Return a context with a folder for the files of a call, which is removed at its end."""
        folder = Path(tempfile.mkdtemp(dir=self.scratch))
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    async def run(self, arguments: Sequence[str], output: Path, *, all_nodes: bool = False) -> Finished:
        """Run `btcore` with *arguments* in the folder *output*.

        Args:
            arguments: The arguments of the command line.
            output: A `temporary_folder`, which is the working directory of the command.
            all_nodes: Whether all installed nodes are used, instead of `SIMULATION`. Only for commands that
                do not run the leaves.

        Raises:
            RefusedError: The command takes too long or prints too much, or too many commands wait.
        """
        if self._slots.statistics().tasks_waiting >= MAX_WAITING:
            raise RefusedError(f"{MAX_WAITING} calls are waiting already; call again when some have ended")
        time_over = (
            f"'btcore {arguments[0]}' did not complete within {self.time_limit:g} s, the time limit of a "
            "call; use a smaller tree, fewer files, a shorter duration, or fewer ticks or seeds, or ask the "
            "user for a higher --time-limit of 'btcore mcp'"
        )
        # Of all threads of a process; it also ends a command whose server was killed.
        seconds = int(4 * self.time_limit) + 10
        limits = [str(limit) for limit in (MEMORY, MAX_FILE, seconds)]
        async with self._slots:
            process = await anyio.open_process(
                [sys.executable, "-m", limited_command.__name__, *limits, *arguments],
                stdin=subprocess.DEVNULL,
                cwd=output,
                env=_environment(output, all_nodes),
                start_new_session=True,
                creationflags=NEW_PROCESS_GROUP,
            )
            try:
                with anyio.move_on_after(self.time_limit) as scope:
                    finished = await _communicate(process, _PATIENCE * self.time_limit, time_over)
                    return Finished(finished.code, *map(self._shorten_paths, finished[1:]))
            finally:
                with anyio.CancelScope(shield=True):
                    await _kill(process)
            assert scope.cancelled_caught
            raise RefusedError(time_over)

    def _shorten_paths(self, text: str) -> str:
        """Return *text* with paths relative to the folder of trees, or to the folder of the call."""
        text = re.sub(re.escape(str(self.scratch)) + r"[/\\](\w+[/\\])?", "", text)
        for folder in (self.folder.root, bundled_trees.folder()):
            text = text.replace(f"{folder}{os.sep}", "")
        return text


def _environment(output: Path, all_nodes: bool) -> dict[str, str]:
    temporary = dict.fromkeys(("HOME", "USERPROFILE", "TMPDIR", "TEMP", "TMP"), str(output))
    limited = {} if all_nodes else {LIMIT_VARIABLE: " ".join(SIMULATION)}
    return {
        **{name: os.environ[name] for name in _KEPT if name in os.environ},
        **temporary,
        **limited,
        SIZE_VARIABLE: str(MAX_FILE),
        "COLUMNS": "160",
        "NO_COLOR": "1",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        # Otherwise Python would import a click.py from the served folder.
        "PYTHONSAFEPATH": "1",
        "PYTHONUTF8": "1",
    }


async def _communicate(process: Process, patience: float, time_over: str) -> Finished:
    """Read the output of *process* until it ends; interrupt it after the time *patience* (s).

    The output of an interrupted process is incomplete, for the reason *time_over*.
    """
    parts: dict[str, bytes] = {}

    async def read(name: str, stream: ByteReceiveStream | None) -> None:
        assert stream is not None
        data = bytearray()
        with suppress(anyio.EndOfStream):
            while True:
                data += await stream.receive()
                if len(data) > MAX_OUTPUT:
                    raise RefusedError(f"the command was stopped: it printed more than {MAX_OUTPUT:,} bytes")
        parts[name] = bytes(data)

    try:
        async with anyio.create_task_group() as group:
            group.start_soon(read, "stdout", process.stdout)
            group.start_soon(read, "stderr", process.stderr)
            with anyio.move_on_after(patience):
                await process.wait()
            is_interrupted = process.returncode is None
            if is_interrupted:
                _interrupt(process)
            code = await process.wait()
    except BaseExceptionGroup as errors:
        refused, _ = errors.split(RefusedError)
        if refused is None:
            raise
        raise refused.exceptions[0] from None
    stdout, stderr = (parts[name].decode(errors="replace") for name in ("stdout", "stderr"))
    return Finished(code, stdout, stderr, time_over if is_interrupted else "")


def _interrupt(process: Process) -> None:
    """Request *process* to end with what it has, as by Ctrl-C."""
    with suppress(ProcessLookupError, PermissionError):
        if sys.platform == "win32":
            process.send_signal(signal.CTRL_BREAK_EVENT)
        else:
            process.send_signal(signal.SIGINT)


async def _kill(process: Process) -> None:
    """Kill *process* and the processes that it started, and wait for its end."""
    if sys.platform == "win32":
        if process.returncode is None:
            command = ["taskkill", "/F", "/T", "/PID", str(process.pid)]
            await anyio.to_thread.run_sync(lambda: subprocess.run(command, capture_output=True, check=False))
    else:
        # The group may still have processes when its leader has ended.
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    await process.aclose()
