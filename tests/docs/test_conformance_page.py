"""docs/reference/conformance.md lists the nodes without recorded cases, and the cases in each file."""

import gzip
import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/reference/conformance.md").read_text(encoding="utf-8")
DATA = sorted((ROOT / "tests" / "conformance" / "data").glob("*.jsonl.gz"))
MUTATED = {"v3_mutated", "v4_mutated"}


def cases(path: Path) -> list[dict[str, object]]:
    with gzip.open(path, "rt", encoding="utf-8") as lines:
        return [json.loads(line) for line in lines]


Cases = dict[str, list[dict[str, object]]]


@pytest.fixture(scope="module")
def all_cases() -> Cases:
    return {path.name.removesuffix(".jsonl.gz"): cases(path) for path in DATA}


def recorded(format: int, all_cases: Cases) -> set[str]:
    """Return the tags of the recorded trees of *format* that were ticked, without the mutated trees."""
    found: set[str] = set()
    for name, some in all_cases.items():
        if name.startswith(f"v{format}_") and name not in MUTATED:
            for case in some:
                if "ticks" in case["expect"]:  # type: ignore[operator]
                    found.update(re.findall(r"<(\w+)", str(case["xml"])))
    return found


@pytest.mark.parametrize("format", [3, 4])
def test_every_built_in_node_is_recorded_or_listed(format: int, all_cases: Cases) -> None:
    (table,) = re.findall(rf"\| nodes of format {format} \|.*?\n\n", PAGE, re.DOTALL)
    nodes = json.loads((DATA[0].parent / "builtin_nodes.json").read_text(encoding="utf-8"))
    assert set(re.findall(r"`(\w+)`", table)) == set(nodes[str(format)]) - recorded(format, all_cases)


def test_every_file_is_listed_with_its_number_of_cases(all_cases: Cases) -> None:
    left = {name: len(some) for name, some in all_cases.items()}
    for line in re.findall(r"^\| (`.*`) \| (\d+) \|", PAGE, re.MULTILINE):
        names = re.findall(r"`(\w+)`", line[0])
        assert sum(left.pop(name) for name in names) == int(line[1])
    assert left == {}
    assert "7882 passed" in PAGE
