"""Docs and examples use public names only."""

import ast
import re
from importlib.util import find_spec
from pathlib import Path

import pytest

import btcore

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
OWN_TESTS = sorted((ROOT / "tests" / "docs").glob("*.py"))
LISTED = set(re.findall(r"`(btcore[\w.]*)`", "".join(
    line.split("|")[1]
    for line in (ROOT / "docs/reference/public_api.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| `")
)))  # fmt: skip


def programs(path: Path) -> list[ast.Module]:
    """Return the Python in *path*: the file itself, or the code blocks of a page."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return [ast.parse(text)]
    found = []
    for block in re.findall(r"```(?:python|pycon|py)[^\n]*\n(.*?)```", text, re.DOTALL):
        lines = [line.removeprefix(">>> ").removeprefix("... ") for line in block.splitlines()]
        try:
            found.append(ast.parse("\n".join(lines)))
        except SyntaxError:
            # A session with output, or a part of a program: its imports are enough.
            imports = [line for line in lines if re.match(r"(from|import) \w", line) and "(" not in line]
            found.append(ast.parse("\n".join(imports)))
    return found


def is_public(module: str, name: str) -> bool:
    """Whether *name* may be imported from *module*."""
    if name.startswith("_"):
        return False
    if module == "btcore":
        return name in btcore.__all__ or f"btcore.{name}" in LISTED
    return module in LISTED or f"{module}.{name}" in LISTED


def private_imports(path: Path) -> list[str]:
    """Return the imports in *path* of names that are not public."""
    found = []
    for program in programs(path):
        for node in ast.walk(program):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("btcore"):
                names = [alias.name for alias in node.names if not is_public(str(node.module), alias.name)]
                found += [f"{node.module}.{name}" for name in names]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names if alias.name.startswith("btcore")]
                found += [name for name in names if name not in LISTED]
    return found


@pytest.mark.parametrize("path", [*PAGES, *EXAMPLES, *OWN_TESTS], ids=lambda path: path.name)
def test_only_public_names_are_imported(path: Path) -> None:
    assert private_imports(path) == []


def test_listed_modules_exist() -> None:
    # Found, not imported: the packages of an extra may be missing.
    assert [name for name in sorted(LISTED) if find_spec(name) is None] == []


def test_the_engine_has_at_most_70_public_names() -> None:
    assert len(btcore.__all__) == len(set(btcore.__all__)) <= 70
    assert all(hasattr(btcore, name) for name in btcore.__all__)
