"""The examples in docstrings run, on both builds: the source files contain them."""

import ast
import doctest
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = [
    path.parent for pattern in ("btcore", "*/btcore_*") for path in ROOT.glob(f"{pattern}/__init__.py")
]
SOURCES = [path for package in PACKAGES for path in package.rglob("*.py")]
FILES = sorted(path for path in SOURCES if ">>> " in path.read_text(encoding="utf-8"))

# The modules without which the examples of a folder cannot run.
NEEDED = {"monitor": "zmq", "robot_nodes": "cv2", "sim": "pybullet"}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_examples_in_docstrings(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip(NEEDED.get(path.relative_to(ROOT).parts[0], "btcore"))
    monkeypatch.chdir(tmp_path)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.REPORT_ONLY_FIRST_FAILURE)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            text = str(node.value.value)
            # Without the globals of the module: an example imports what it uses.
            names = {"__name__": "__main__"}
            example = doctest.DocTestParser().get_doctest(text, names, path.stem, str(path), node.lineno - 1)
            if example.examples:
                runner.run(example)
    assert runner.tries
    assert runner.failures == 0


def test_work_of_a_threaded_action_uses_no_ports() -> None:
    """Only the thread that ticks a tree may use them."""
    path = ROOT / "btcore/engine/threaded.py"
    docstrings = [
        ast.get_docstring(node)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    ]
    examples = [line for text in docstrings for line in doctest.DocTestParser().get_examples(text or "")]
    found = [
        node for line in examples for node in ast.parse(line.source).body if isinstance(node, ast.ClassDef)
    ]
    assert found
    for leaf in found:
        ports = {ast.unparse(node.target) for node in leaf.body if isinstance(node, ast.AnnAssign)}
        work = next(node for node in leaf.body if isinstance(node, ast.FunctionDef) and node.name == "work")
        assert ports & {node.attr for node in ast.walk(work) if isinstance(node, ast.Attribute)} == set()
