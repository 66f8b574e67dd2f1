"""Processes are killed at random moments: everything recorded before is readable and complete.

``python tests/acceptance/kills.py --trials 100`` kills (SIGKILL) the run, the recorder or both during
``--save``, a run during ``--record``, a mapping run with ``--save-map``, the scheduler, a worker or both of a
sweep, and a run with ``--json``. It prints a line for each kind, and exits with 1 on any loss:

- A recording has every transition that the log of the run's own process has, up to AGE before the kill.
- A replay of what ``--record`` has written does the same as the run, up to AGE before the kill. Such a trial
  kills RUNS runs.
- A map file is the map that was there before, or a complete new map.
- A sweep that is run again has the same table as a sweep that was not killed.
- The output of ``--json`` is empty or complete.
"""

import argparse
import csv
import json
import os
import random
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import cycle
from pathlib import Path
from subprocess import DEVNULL, Popen
from tempfile import TemporaryDirectory
from threading import Event, Thread
from typing import IO

import psutil
from checkout import environment
from sweep import workers

from btcore.errors import BtcoreError
from btcore.logs import LogError, read_btlog, read_log
from btcore_recorder.files import EXTENSIONS
from btcore_robot.occupancy_map import load_map
from recording import logged, recorded

AGE = 1.0
"""How old a transition must be at the time of the kill (s) to be expected in a recording."""
RUNS = 10
"""The number of runs with ``--record`` that a trial kills."""
PATIENCE = 120.0
"""How long a process may take to end (s)."""
STEPS = """<root BTCPP_format="4"><BehaviorTree ID="Steps"><Repeat num_cycles="-1"><Sequence>
<Sleep msec="30"/><Script code="n := 1"/><Inverter><AlwaysFailure/></Inverter>
</Sequence></Repeat></BehaviorTree></root>"""
WAIT = """<root BTCPP_format="4"><BehaviorTree ID="Wait"><Sequence>
<Sleep msec="{msec}"/><ScriptCondition code="msec != 3000"/>
</Sequence></BehaviorTree></root>"""
EPISODES = 200
SWEEP = ("sweep", "wait.xml", "--seeds", str(EPISODES // 4), "--param", "bb.msec=1000,2000,3000,4000")

Trial = Callable[[Path, random.Random], str]
"""A trial in an empty folder; returns what was lost, or an empty text."""


def start(folder: Path, *arguments: str, output: IO[bytes] | int = DEVNULL) -> "Popen[bytes]":
    """Start ``btcore`` with *arguments* in *folder*."""
    command = [sys.executable, "-m", "btcore", *arguments]
    return Popen(command, cwd=folder, stdout=output, stderr=DEVNULL, env=environment())


def kill(*processes: "psutil.Process | Popen[bytes]") -> None:
    """Kill *processes*; those that have ended already are ignored."""
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process.pid, signal.SIGKILL)


def wait_until(holds: Callable[[], object], process: "Popen[bytes]") -> None:
    """Wait until *holds* returns a true value or *process* has ended."""
    end = time.monotonic() + PATIENCE
    while not holds() and process.poll() is None:
        if time.monotonic() > end:
            raise TimeoutError(f"nothing happened in {PATIENCE:g} s")
        time.sleep(0.01)


class DelayMeter(Thread):
    """Measures by how much a short sleep was exceeded at most: for so long, the machine did nothing."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.greatest = 0.0
        self._end = Event()

    def run(self) -> None:
        while not self._end.is_set():
            began = time.monotonic()
            time.sleep(0.01)
            self.greatest = max(self.greatest, time.monotonic() - began - 0.01)

    def __enter__(self) -> "DelayMeter":
        self.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._end.set()
        self.join()


def recording_trial(*, run: bool, recorder: bool) -> Trial:
    """Return the trial that kills the *run*, its *recorder*, or both during ``--save``."""

    def trial(folder: Path, rng: random.Random) -> str:
        (folder / "steps.xml").write_text(STEPS)
        log, recording = folder / "steps.btlog", folder / "steps.rrd"
        files = ("--save", recording.name, "--log", log.name)
        with start(folder, "run", "steps.xml", "--rate", "50", *files) as process:
            wait_until(lambda: log.exists() and log.stat().st_size, process)
            with DelayMeter() as delay:
                time.sleep(rng.uniform(0.0, 4.0))
                children = psutil.Process(process.pid).children()
                killed_at = time.time()
                kill(*children * recorder, *[process] * run)
            time.sleep(AGE)
            # A process that was not killed ends as after Ctrl-C: the recorder would wait for another run.
            for survivor in (process, *children):
                with suppress(ProcessLookupError, psutil.NoSuchProcess):
                    survivor.send_signal(signal.SIGINT)
            process.wait(PATIENCE)
        psutil.wait_procs(children, PATIENCE)
        # On a busy machine, other processes were delayed as well, and perhaps longer.
        before = (killed_at - AGE - 3.0 * delay.greatest) * 1e9
        expected = sum(change.stamp < before for change in read_btlog(log).transitions)
        try:
            kept = recorded(recording) if recording.exists() else []
        except ValueError:  # the recorder was killed before it wrote the first transition
            kept = []
        if kept != logged(log)[: len(kept)]:
            return f"the {len(kept)} recorded transitions differ from the log"
        return "" if len(kept) >= expected else f"{len(kept)} transitions recorded, {expected} expected"

    return trial


def record_trial(folder: Path, rng: random.Random) -> str:
    """Kill runs during ``--record``."""
    (folder / "steps.xml").write_text(STEPS)
    names = [f"{number}{rng.choice(EXTENSIONS)}" for number in range(RUNS)]
    runs = []
    for name in names:
        files = ("--record", name, "--log", f"{name}.btlog")
        runs.append(start(folder, "run", "steps.xml", "--rate", "50", *files))
    lost = []
    with DelayMeter() as delay:
        for name, process in zip(names, runs, strict=True):
            log = folder / f"{name}.btlog"
            wait_until(lambda log=log: log.exists() and log.stat().st_size, process)  # type: ignore[misc]
            time.sleep(rng.uniform(0.0, 0.7))
            killed_at = time.time()
            kill(process)
            process.wait(PATIENCE)
            before = (killed_at - AGE - 3.0 * delay.greatest) * 1e9
            transitions = read_btlog(log).transitions
            expected = sum(change.stamp < before for change in transitions)
            try:
                recording = read_log(folder / name)
            except LogError:  # it was killed before the head was written
                kept = 0
            else:
                kept = len(recording.transitions)
                changes = [
                    [(change.uid, change.status) for change in each[:kept]]
                    for each in (recording.transitions, transitions)
                ]
                # The log lacks the last tick, if the process was killed between both writes.
                if changes[0][: len(changes[1])] != changes[1] or "differs" in recording.damage:
                    lost.append(f"{name}: the {kept} transitions of the replay differ from the log")
            if kept < expected:
                lost.append(f"{name}: {kept} transitions recorded, {expected} expected")
    return "; ".join(lost)


def map_trial(folder: Path, rng: random.Random) -> str:
    """Kill a mapping run, most likely while it writes the map over an earlier map."""

    def content() -> list[bytes]:
        load_map(folder / "map.yaml")
        return [(folder / name).read_bytes() for name in ("map.yaml", "map.pgm")]

    def mapping(seconds: int) -> "Popen[bytes]":
        arguments = ("mapping", "--fast", "--duration", str(seconds), "--save-map", "map.yaml")
        return start(folder, "run", *arguments)

    mapping(10).wait(PATIENCE)
    new = content()
    mapping(5).wait(PATIENCE)
    old = content()
    began = time.monotonic()
    mapping(10).wait(PATIENCE)
    took = time.monotonic() - began
    mapping(5).wait(PATIENCE)
    with mapping(10) as process:
        time.sleep(rng.uniform(0.6, 1.1) * took)
        kill(process)
    return "" if content() in (old, new) else "the map is neither the earlier nor the new map"


def sweep_trial(*, scheduler: bool, worker: bool) -> Trial:
    """Return the trial that kills the *scheduler*, a *worker*, or both of a sweep, and runs it again."""

    def trial(folder: Path, rng: random.Random) -> str:
        (folder / "wait.xml").write_text(WAIT)
        journal = folder / "wait.sweep" / "journal.jsonl"
        with start(folder, *SWEEP) as process:
            count = rng.randrange(EPISODES)
            wait_until(lambda: journal.exists() and journal.read_bytes().count(b"\n") >= count, process)
            kill(*workers(process)[: worker and 1], *[process] * scheduler)
            process.wait(PATIENCE)
        saved = [json.loads(line) for line in journal.read_bytes().split(b"\n")[:-1]]
        with (
            (folder / "out.json").open("wb") as output,
            start(folder, *SWEEP, "--json", output=output) as process,
        ):
            process.wait(PATIENCE)
        with (folder / "wait.sweep" / "results.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        results = [(row["episode"], row["status"]) for row in rows]
        expected = [(str(number), ("SUCCESS", "FAILURE")[number % 4 == 2]) for number in range(EPISODES)]
        again = [json.loads(line) for line in journal.read_bytes().split(b"\n")[:-1]]
        if results != expected:
            return f"{len(set(expected) - set(results))} of {EPISODES} results are missing or differ"
        return "" if again[: len(saved)] == saved else "episodes of the first sweep were lost"

    return trial


def json_trial(folder: Path, rng: random.Random) -> str:
    """Kill a run with ``--json``."""
    output = folder / "out.json"
    (folder / "steps.xml").write_text(STEPS)
    with output.open("wb") as file:
        arguments = ("steps.xml", "--fast", "--duration", "60", "--json")
        with start(folder, "run", *arguments, output=file) as process:
            time.sleep(rng.uniform(0.2, 3.0))
            kill(process)
    text = output.read_bytes()
    return "" if not text or isinstance(json.loads(text), dict) else "the output is not an object"


TRIALS: dict[str, Trial] = {
    "--save, run killed": recording_trial(run=True, recorder=False),
    "--save, recorder killed": recording_trial(run=False, recorder=True),
    "--save, both killed": recording_trial(run=True, recorder=True),
    "--record": record_trial,
    "--save-map": map_trial,
    "sweep, scheduler killed": sweep_trial(scheduler=True, worker=False),
    "sweep, worker killed": sweep_trial(scheduler=False, worker=True),
    "sweep, both killed": sweep_trial(scheduler=True, worker=True),
    "--json": json_trial,
}


def main() -> int:
    """Run the trials, print the results, and return 1 if anything was lost, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--trials", type=int, default=100, help="how many (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the moments (default: %(default)s)")
    options = parser.parse_args()
    lost: dict[str, list[str]] = {name: [] for name in TRIALS}
    for number, name in zip(range(options.trials), cycle(TRIALS), strict=False):
        with TemporaryDirectory(prefix="btcore-") as folder:
            try:
                loss = TRIALS[name](Path(folder), random.Random(f"{options.seed} {number}"))
            except (BtcoreError, ValueError, OSError) as error:
                loss = f"{type(error).__name__}: {error}"
        lost[name].append(loss)
        if loss:
            print(f"miss: trial {number}, {name}: {loss}", flush=True)
    for name, losses in lost.items():
        print(f"{name}: {losses.count('')} of {len(losses)} without a loss")
    return 1 if any(map(any, lost.values())) else 0


if __name__ == "__main__":
    raise SystemExit(main())
