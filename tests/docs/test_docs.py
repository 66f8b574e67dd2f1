"""Every example in the documentation runs.

The blocks of a page that are marked ``python`` are one program, run from top to bottom in an empty folder.
Where it defines tests, pytest runs it, with the plugin of btcore. Other blocks aren't run.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import btcore

ROOT = Path(__file__).parent.parent.parent
HOME = Path(btcore.__file__).parent.parent
PAGES = sorted((ROOT / "docs").rglob("*.md"))
FENCE = re.compile(r"( *)(`{3,}|~{3,}) *(.*?) *$")


def program(page: str) -> str:
    """The Python of *page*, each line at its number, and empty lines for all else."""
    lines: list[str] = []
    fence, indent, kept = "", "", False
    for line in page.splitlines():
        met = FENCE.match(line)
        if not fence and met is not None:
            indent, fence, kept = met[1], met[2], met[3] == "python"
            lines.append("")
        elif fence and met is not None and met[2].startswith(fence) and not met[3]:
            fence = ""
            lines.append("")
        else:
            lines.append(line.removeprefix(indent) if fence and kept else "")
    return "\n".join(lines) + "\n"


def run(page: str, name: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the program of *page* in *folder*, as a script or by pytest."""
    source = program(page)
    tests = re.search(r"^(async )?def test_", source, re.MULTILINE) is not None
    script = folder / f"{'test_' * tests}{name}.py"
    script.write_text(source, encoding="utf-8")
    empty = folder / "empty"
    empty.mkdir()
    by_pytest = ["-m", "pytest", "-q", "-p", "btcore.testing.plugin", "-p", "no:cacheprovider", "--tb=short"]
    return subprocess.run(
        [sys.executable, *(by_pytest if tests else []), str(script)],
        cwd=empty,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(HOME), str(ROOT)]),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
            "PYTHONWARNINGS": "error",
        },
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_the_examples_of_a_page_run(page: Path, tmp_path: Path) -> None:
    done = run(page.read_text(encoding="utf-8"), page.stem, tmp_path)
    assert done.returncode == 0, f"{page}\n{done.stdout}\n{done.stderr}"


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_what_a_page_points_to_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text) if "://" not in link]
    assert [link for link in links if not (page.parent / link).exists()] == []


# --- the runner


def test_blocks_run_in_order_and_know_each_other(tmp_path: Path) -> None:
    page = "# A page\n```python\na = 1\n```\nThen:\n\n- so\n  ```python\n  print(a + 1)\n  ```\n"
    assert run(page, "page", tmp_path).stdout == "2\n"


def test_other_blocks_do_not_run(tmp_path: Path) -> None:
    page = "```console\n$ false\n```\n```\nnonsense(\n```\n```pycon\n>>> 1\n```\n~~~text\n```python\n~~~\n"
    done = run(page, "page", tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_block_that_fails_is_told_by_its_line_in_the_page(tmp_path: Path) -> None:
    done = run("one\n\n```python\na = 1\nassert a == 2\n```\n", "page", tmp_path)
    assert done.returncode == 1
    assert "line 5" in done.stderr


def test_tests_in_a_page_are_run_with_the_fixtures_of_btcore(tmp_path: Path) -> None:
    page = "```python\ndef test_it(clock):\n    assert clock.now() == {}\n```\n"
    assert "1 passed" in run(page.format(0), "good", tmp_path).stdout
    (tmp_path / "empty").rmdir()
    assert "1 failed" in run(page.format(1), "bad", tmp_path).stdout
