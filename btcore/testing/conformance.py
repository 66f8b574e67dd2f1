"""Runs recorded conformance cases: ``python -m btcore.testing.conformance FILE.jsonl.gz …``.

Prints ``N passed, M failed`` and the first differences, and exits 1 if there is any.
"""

import gzip
import json
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from btcore.registry import Registry
from btcore.testing.recorded_trees import planned_registry, tree_difference
from btcore.testing.recorded_values import convert_difference, script_difference

SHOWN = 10
KINDS = {"xml", "script", "convert"}


def cases(path: Path) -> Iterator[dict[str, Any]]:
    """The cases in *path*, one JSON object a line, gzipped or not. Raises ValueError for any other line."""
    with (
        gzip.open(path, "rt", encoding="utf-8")
        if path.suffix == ".gz"
        else path.open(encoding="utf-8") as lines
    ):
        for number, line in enumerate(lines, start=1):
            if line.strip():
                case = json.loads(line)
                if not isinstance(case, dict) or "expect" not in case or not KINDS & case.keys():
                    raise ValueError(f"line {number} is no case")
                yield case


def difference(case: dict[str, Any], nodes: Registry) -> str | None:
    """What differs in *case*, or None. Whatever an engine's fault raises is a difference too."""
    try:
        if "convert" in case:
            return convert_difference(case)
        if "script" in case:
            return script_difference(case)
        return tree_difference(case, nodes)
    except Exception as fault:
        return f"the runner raised {type(fault).__name__}: {fault}"


def main(arguments: list[str]) -> int:
    """Run the files named by *arguments*; the exit code."""
    if not arguments or arguments[0] in ("-h", "--help"):
        print(__doc__)
        return 2
    nodes = planned_registry()
    passed = 0
    differing: list[str] = []
    for name in arguments:
        try:
            for case in cases(Path(name)):
                found = difference(case, nodes)
                if found is None:
                    passed += 1
                else:
                    differing.append(f"{name}: {case.get('id', '?')}: {found}")
        except (OSError, ValueError, EOFError, zlib.error) as fault:
            print(f"{name}: can't be read as recorded cases: {fault}", file=sys.stderr)
            return 2
    print(f"{passed} passed, {len(differing)} failed")
    for line in differing[:SHOWN]:
        print(line)
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
