"""The time of a start: importing btcore, loading a small tree, and ``btcore --version``.

    python benchmarks/startup.py [--pairs 9] [--quick] [--json]

Each program runs in a new process. Its time is the additional processor time, compared with a Python that
does nothing. Importing and loading are compared with the import of lxml and some standard modules, which
every such library needs, and ``--version`` with the imports of click's own ``--version``: click and
importlib.metadata.
"""

import os
import resource
import subprocess
import sys

from measure.paired_timing import Spread
from measure.report import Report, at_most, create_parser

MODULES = "import lxml.etree, typing, dataclasses, re, enum, pathlib"
TREE = (
    '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>'
    "<AlwaysSuccess/><AlwaysSuccess/></Sequence></BehaviorTree></root>"
)
PROGRAMS = {
    "bare": "pass",
    "modules": MODULES,
    "import btcore": "import btcore",
    "import btcore, and load three nodes": f"import btcore; btcore.loads({TREE!r})",
    "click": "import click, importlib.metadata",
    "btcore --version": "import sys; sys.argv[1:] = ['--version']; from btcore.cli.main import main; main()",
}
BESIDE_MODULES = at_most(pure=1.8, compiled=1.8)
BESIDE_CLICK = at_most(pure=1.5, compiled=1.5)
ENVIRONMENT = {name: text for name, text in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
RUNS = 5
"""The number of runs of each program. The shortest run counts, because it was disturbed least."""


def measure_process(program: str) -> float:
    """Return the processor time (s) of a new Python that runs *program*."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", program], env=ENVIRONMENT, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Run the benchmark."""
    options = create_parser(__doc__ or "").parse_args()
    report = Report("startup", "The cost of a start, in excess of a Python that does nothing", options.pairs)
    rounds: list[dict[str, float]] = []
    for program in PROGRAMS.values():
        measure_process(program)  # compiles the sources
    for _ in range(options.pairs):
        times = dict.fromkeys(PROGRAMS, float("inf"))
        for _ in range(1 if options.quick else RUNS):
            for name, program in PROGRAMS.items():
                times[name] = min(times[name], measure_process(program))
        rounds.append({name: time - times["bare"] for name, time in times.items()})
    for name, peer, target in (
        ("import btcore", "modules", BESIDE_MODULES),
        ("import btcore, and load three nodes", "modules", BESIDE_MODULES),
        ("btcore --version", "click", BESIDE_CLICK),
    ):
        ratio = Spread.of([times[name] / times[peer] for times in rounds])
        took = Spread.of([times[name] for times in rounds]).median
        report.add(f"{name} / {peer}", ratio, target, {"took": f"{took * 1e3:.0f} ms"})
    report.output(options.json)


if __name__ == "__main__":
    main()
