"""Commands that run in parallel: generators and compilers."""

import os
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from btcore_ros2.errors import RosError

PROCESSES: Final = os.cpu_count() or 1
_POLL_S: Final = 0.02
_SHOWN_LINES: Final = 12
"""How many lines of a command's output an error message contains."""


def run_jobs(commands: Sequence[Sequence[str]], folder: Path, done: Callable[[], None]) -> None:
    """Run *commands*, as many at a time as the machine has cores. All of them end with this function.

    Args:
        commands: The commands. None of them needs the result of another.
        folder: The folder in which they run, and for the files with their output.
        done: Called after each command.

    Raises:
        RosError: A command failed or cannot be started. The message contains the first lines of its output.
    """
    waiting = list(reversed(commands))
    running: list[tuple[subprocess.Popen[bytes], Path]] = []
    try:
        while waiting or running:
            while waiting and len(running) < PROCESSES:
                command = waiting.pop()
                log = folder / f"{len(waiting)}.log"
                with log.open("wb") as output:
                    try:
                        process = subprocess.Popen(
                            command, cwd=folder, stdout=output, stderr=subprocess.STDOUT
                        )
                    except OSError as error:
                        raise RosError(f"{command[0]} cannot be started: {error}") from error
                running.append((process, log))
            for entry in tuple(running):
                process, log = entry
                try:
                    code = process.wait(_POLL_S)
                except subprocess.TimeoutExpired:
                    continue
                running.remove(entry)
                if code != 0:
                    raise RosError(_failure(process.args, code, log))
                done()
    finally:
        for process, _ in running:
            process.kill()
            process.wait()


def _failure(command: object, code: int, log: Path) -> str:
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    # A compiler prints its first error first, and a Python program its exception last.
    shown = lines[-_SHOWN_LINES:] if "Traceback (most recent call last):" in lines else lines[:_SHOWN_LINES]
    name = Path(command[0]).name if isinstance(command, list | tuple) else str(command)
    return "\n".join([f"{name} failed with exit code {code}:", *(f"  {line}" for line in shown)])
