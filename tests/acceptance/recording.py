"""A patrol of ten minutes is recorded without a missing transition, counted against the in-process logger.

``python tests/acceptance/recording.py`` records a run by the wire (``--save``) and by its log (``--log``),
compares the two transition by transition, and exits with 1 on any difference.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from checkout import environment
from rerun.chunk import RrdReader

from btcore.logs import read_btlog

COLUMNS = ("number", "uid", "previous", "status")
Change = tuple[int, ...]


def read_recording_changes(path: Path) -> list[Change]:
    """Return (number, uid, previous, status) of every transition in a recording, by number."""
    return sorted(read_rows(path))


def read_rows(path: Path) -> Iterator[Change]:
    """Yield the transitions of a recording in the order of the file."""
    for chunk in RrdReader(path).stream():
        if str(chunk.entity_path) == "/log/numbers":
            batch = chunk.to_record_batch()
            columns = [[value for (value,) in batch.column(name).to_pylist()] for name in COLUMNS]
            yield from zip(*columns, strict=True)


def read_log_changes(path: Path) -> list[Change]:
    """Return the transitions in a log of the in-process logger, as `read_recording_changes` does."""
    return [
        (number, change.uid, int(change.previous), int(change.status))
        for number, change in enumerate(read_btlog(path).transitions, start=1)
    ]


def main() -> int:
    """Run, compare the files, and return 1 if they differ, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--duration", type=float, default=600.0, help="s of the robot's time")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="btcore-") as folder:
        recording, log = Path(folder) / "patrol.rrd", Path(folder) / "patrol.btlog"
        command = [sys.executable, "-m", "btcore", "run", "patrolling", "--world", "house", "--fast"]
        command += ["--seed", str(options.seed), "--duration", str(options.duration)]
        subprocess.run(
            [*command, "--save", str(recording), "--log", str(log)],
            check=True,
            stdout=subprocess.DEVNULL,
            env=environment(),
        )
        by_wire, by_log = read_recording_changes(recording), read_log_changes(log)
    differences = sum(first != second for first, second in zip(by_wire, by_log, strict=False))
    print(f"{len(by_log)} transitions logged, {len(by_wire)} recorded, {differences} differences")
    return 1 if not by_log or by_wire != by_log else 0


if __name__ == "__main__":
    raise SystemExit(main())
