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

from btcore.registry.registry import Registry
from btcore.testing.conformance_trees import compare_tree_case, conformance_registry
from btcore.testing.conformance_values import compare_conversion_case, compare_script_case

SHOWN = 10
KINDS = {"xml", "script", "convert"}


def read_cases(path: Path) -> Iterator[dict[str, Any]]:
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


def compare_case(case: dict[str, Any], nodes: Registry) -> str | None:
    """What differs in *case*, or None. Whatever an engine's fault raises is a difference too."""
    try:
        if "convert" in case:
            return compare_conversion_case(case)
        if "script" in case:
            return compare_script_case(case)
        return compare_tree_case(case, nodes)
    except Exception as fault:
        return f"the runner raised {type(fault).__name__}: {fault}"


def main(arguments: list[str]) -> int:
    """Run the files named by *arguments*; the exit code."""
    if not arguments or arguments[0] in ("-h", "--help"):
        print(__doc__)
        return 2
    nodes = conformance_registry()
    passed = 0
    differing: list[str] = []
    for name in arguments:
        try:
            for case in read_cases(Path(name)):
                found = compare_case(case, nodes)
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
