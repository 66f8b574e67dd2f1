"""Every example in the documentation runs, in a new empty folder for each page.

The words after a block's fence determine its kind:

- ``python``: a part of the page's program, which runs from top to bottom; where it defines tests, pytest
  runs it, with the plugin of btcore.
- ``python NAME.py``, ``xml NAME.xml``, ``json NAME.json`` etc.: a file, written before anything runs. The
  program, a command or another file uses it. A later block with the same name replaces the file for the
  commands below it.
- ``console``: commands for a shell, after ``$``, run after the program. The text below a command is its
  output, in which ``…`` matches any text; a command with nothing below it must succeed.
- ``diff``: a change of a file of the repository, as printed by ``git diff --no-prefix``. The page's folder is
  then a copy of the repository, not empty, and all changes are applied to the copy before anything runs. The
  copy has ``.venv/bin``, as a clone has. The numbers in ``@@ … @@`` may be outdated.
- ``xml E101``: an example of docs/reference/errors.md, which tests/btcore/test_diagnostic_codes.py runs.
- ``text``, ``toml``, ``cpp``: to be read.

Any of them may be ``unrun: REASON``, and is not run then. Other kinds are errors.
"""

import importlib.util
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

import btcore
from btcore import builds

ROOT = Path(__file__).parent.parent.parent
HOME = Path(btcore.__file__).parent.parent
NAVIGATION = ROOT / "docs/site/navigation.md"
# Pages of the root folder are part of the site, too. tests/test_readme.py runs README.md.
ROOT_PAGES = set(ROOT.glob("*.md")) - {ROOT / "README.md"}
PAGES = sorted({*(ROOT / "docs").rglob("*.md"), *ROOT_PAGES} - {NAVIGATION})
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
BOOK_NEEDS = ("numpy", "cv2", "yaml", "pybullet")
NEEDS = {
    "agents": ("mcp",),
    "batch": ("numpy",),
    "bump_and_go": BOOK_NEEDS,
    "failed_last_night": BOOK_NEEDS,
    "monitor_your_robot": ("zmq", "msgpack", "rerun"),
    "recording": ("zmq", "msgpack", "rerun"),
    "proving": BOOK_NEEDS,
    "protocols": ("zmq", "msgpack"),
    "security": ("zmq", "msgpack"),
    "add_a_node": (*BOOK_NEEDS, "zmq", "msgpack"),
    "add_a_wire_message": ("zmq", "msgpack"),
    "add_a_robot": BOOK_NEEDS,
    "add_a_world": BOOK_NEEDS,
    "your_resources": ("distributed",),
    "your_robot": ("numpy", "cv2", "scipy", "yaml", "zmq", "msgpack"),
    "mapping": BOOK_NEEDS,
    "navigation": BOOK_NEEDS,
    "patrol": BOOK_NEEDS,
    "sweeps": ("distributed",),
    "type_checkers": ("mypy",),
    "worlds": BOOK_NEEDS,
}
FENCE = re.compile(r"( *)(`{3,}|~{3,}) *(.*?) *$")
FILE = re.compile(r"(python|xml|json|yaml|toml) ([\w.]+\.(?:py|xml|urdf|json|yaml|toml))")
# What a page with changes of the repository may change, import or test.
COPIED = (
    "btcore",
    "docs",
    "monitor",
    "robot_nodes",
    "ros2",
    "sim",
    "tests",
    "tools",
    "trees",
    "CHANGELOG.md",
    "pyproject.toml",
)
# `btcore run` prints such a line every 10 s of real time.
PROGRESS = re.compile(r"^\S+ +[A-Z]+  .* tick \d+  ×.*\n", re.MULTILINE)
KINDS = re.compile(r"python|console|diff|text|toml|cpp|xml [EWC]\d{3}|[a-z]+ unrun: .{8,}")


LIMIT = 250
"""The longest time (s) of a program or a command, on a slow machine."""


class Block(NamedTuple):
    """A fenced block: the words after its fence, the number of its first line, and its lines."""

    info: str
    line: int
    lines: list[str]

    @property
    def text(self) -> str:
        return "\n".join(self.lines) + "\n"


def blocks(page: str) -> list[Block]:
    """The fenced blocks of *page*, in order, without the indentation of their fences."""
    found: list[Block] = []
    fence, indent = "", ""
    for number, line in enumerate(page.splitlines(), 1):
        match = FENCE.match(line)
        if not fence and match is not None:
            indent, fence = match[1], match[2]
            found.append(Block(match[3], number + 1, []))
        elif fence and match is not None and match[2].startswith(fence) and not match[3]:
            fence = ""
        elif fence:
            found[-1].lines.append(line.removeprefix(indent))
    return found


def program(page: str) -> str:
    """Return the Python of *page*, each line at its number, with empty lines in place of other text."""
    lines = [""] * len(page.splitlines())
    for block in blocks(page):
        if block.info == "python":
            lines[block.line - 1 : block.line - 1 + len(block.lines)] = block.lines
    return "\n".join(lines) + "\n"


def files(page: str, before: int = sys.maxsize) -> dict[str, list[str]]:
    """The files that *page* shows, by name: their contents above line *before*, in order."""
    found: dict[str, list[str]] = {}
    for block in blocks(page):
        if (match := FILE.fullmatch(block.info)) and block.line < before:
            found.setdefault(match[2], []).append(block.text)
    return found


def commands(page: str) -> list[tuple[int, str, str]]:
    """Return the commands of *page*: line number, command, and the output that the page shows."""
    found: list[tuple[int, str, str]] = []
    for block in blocks(page):
        if block.info == "console":
            for number, line in enumerate(block.lines, block.line):
                if line.startswith("$ "):
                    found.append((number, line[2:], ""))
                else:
                    before = found.pop()
                    found.append((*before[:2], before[2] + line + "\n"))
    return found


def changes(page: str) -> list[str]:
    """Return the patches in *page*, one per file of the repository."""
    return [block.text for block in blocks(page) if block.info == "diff"]


def patch_copy(patches: list[str], folder: Path) -> None:
    """Copy the sources of the repository to *folder*, and apply *patches* to the copy."""
    for name in COPIED:
        if (ROOT / name).is_dir():
            unused = shutil.ignore_patterns("*.so", "*.pyd", "*.png", ".*")
            shutil.copytree(ROOT / name, folder / name, ignore=unused)
        else:
            shutil.copy(ROOT / name, folder)
    # Without this variable git would look for a repository in the folders above.
    apart = {**os.environ, "GIT_CEILING_DIRECTORIES": str(folder.parent.resolve())}
    for patch in patches:
        done = subprocess.run(
            ["git", "apply", "-p0", "--recount", "-"],
            cwd=folder,
            env=apart,
            input=patch,
            capture_output=True,
            encoding="utf-8",
            check=False,
        )
        assert done.returncode == 0, f"a change of the page cannot be applied:\n{done.stderr}\n{patch}"


def output_matches(shown: str, output: str) -> bool:
    """Whether *output* is *shown*, in which … matches any text, and alone on a line any lines."""
    lines = [
        "(?s:.*)" if line == "…" else re.escape(line.rstrip()).replace("…", ".*")
        for line in shown.strip().splitlines()
    ]
    return re.fullmatch("\n".join(lines), re.sub(r"[ \t]+$", "", output, flags=re.M).strip()) is not None


def environment(folder: Path) -> dict[str, str]:
    """The variables of a program or a command: this build of btcore, or the patched copy, and its command."""
    copy = folder / "empty"
    patched = (copy / "btcore").is_dir()
    tools = copy / ".venv/bin" if patched else folder / "tools"
    tools.mkdir(parents=True, exist_ok=True)
    for name, module in (("btcore", "-m btcore"), ("pytest", "-m pytest"), ("python", "")):
        (tools / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {module} "$@"\n', encoding="utf-8")
        (tools / name).chmod(0o755)
    root = copy if patched else ROOT
    sources = [
        copy if patched else HOME,
        *(root / part for part in ("", "monitor", "robot_nodes", "ros2", "sim", "tools")),
    ]
    return {
        **os.environ,
        # Unbuffered, the output on stdout and stderr is interleaved as in a terminal.
        "PYTHONUNBUFFERED": "1",
        "PATH": os.pathsep.join([str(tools), os.environ["PATH"]]),
        "PYTHONPATH": os.pathsep.join(map(str, sources)),
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        "PYTHONWARNINGS": "error",
        "CI": "true",  # Hypothesis accepts that the machine is slow, and keeps no examples
        # Hypothesis finds its tables of characters there.
        "HYPOTHESIS_STORAGE_DIRECTORY": str(ROOT / ".hypothesis"),
        "NO_COLOR": "1",
        "COLUMNS": "110",
    }


def run(page: str, name: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the program of *page* beside its files, as a script or by pytest."""
    source = program(page)
    tests = re.search(r"^(async )?def test_", source, re.MULTILINE) is not None
    script = folder / f"{'test_' * tests}{name}.py"
    script.write_text(source, encoding="utf-8")
    empty = folder / "empty"
    empty.mkdir()
    if patches := changes(page):
        patch_copy(patches, empty)
    for file, texts in files(page).items():
        (empty / file).write_text(texts[0], encoding="utf-8")
    if not source.strip():
        return subprocess.CompletedProcess([], 0, "", "")
    by_pytest = [
        "-m",
        "pytest",
        "-q",
        "-p",
        "btcore.testing.pytest_plugin",
        "-p",
        "no:cacheprovider",
        "--tb=short",
    ]
    return subprocess.run(
        [sys.executable, *(by_pytest if tests else []), str(script)],
        cwd=empty,
        env=environment(folder),
        capture_output=True,
        text=True,
        check=False,
        timeout=LIMIT,
    )


class CommandServer:
    """Runs commands in forks of a process that has imported btcore (command_server.py)."""

    def __init__(self, folder: Path) -> None:
        self.output = folder / "output"
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).parent / "command_server.py")],
            env=environment(folder),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def run(self, command: str, folder: Path) -> subprocess.CompletedProcess[str]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        request = [str(folder), str(self.output), *shlex.split(command)[1:]]
        print(json.dumps(request), file=self._process.stdin, flush=True)
        code = int(self._process.stdout.readline())
        return subprocess.CompletedProcess(command, code, self.output.read_text(encoding="utf-8"))

    def close(self) -> None:
        """End the process and a command that is still running."""
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.communicate()


@pytest.fixture(scope="session")
def command_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CommandServer | None]:
    if not hasattr(os, "fork"):
        yield None
        return
    server = CommandServer(tmp_path_factory.mktemp("command_server"))
    yield server
    server.close()


def needs_no_shell(command: str) -> bool:
    """Whether *command* is a command of btcore alone. Commands that start processes do not count."""
    without_texts = re.sub(r"'[^']*'|\"[^\"$`\\]*\"", "", command)
    return re.fullmatch(r"btcore (?!sweep|monitor)[\w \t./:=,+@%^-]+", without_texts) is not None


def run_commands(page: str, folder: Path, server: CommandServer | None = None) -> list[str]:
    """Run the commands of *page* in the folder of its program; return the unexpected results."""
    wrong = []
    written = dict.fromkeys(files(page), 1)
    for line, command, shown in commands(page):
        for file, texts in files(page, before=line).items():
            if len(texts) > written[file]:
                (folder / "empty" / file).write_text(texts[-1], encoding="utf-8")
                written[file] = len(texts)
        parts = re.fullmatch(r"(.*?)( \|\| true|; test \$\? = (\d+))?", command)
        assert parts is not None
        plain, end, expected = parts.groups()
        if server is not None and needs_no_shell(plain):
            done = server.run(plain, folder / "empty")
            if end is not None:
                done.returncode = int(expected is not None and done.returncode != int(expected))
        else:
            done = subprocess.run(
                ["bash", "-c", command],
                cwd=folder / "empty",
                env=environment(folder),
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                check=False,
                timeout=LIMIT,
            )
        output = PROGRESS.sub("", done.stdout)
        if not output_matches(shown, output) if shown else done.returncode != 0:
            wrong.append(f"line {line}: {command}\nends with {done.returncode} and prints\n{done.stdout}")
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_the_examples_of_a_page_run(page: Path, tmp_path: Path, command_server: CommandServer | None) -> None:
    for module in BOOK_NEEDS if page.parent.name == "book" else NEEDS.get(page.stem, ()):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed")
    text = page.read_text(encoding="utf-8")
    if changes(text) and builds.active_build() == "compiled":
        pytest.skip("the patched copy is not compiled; the tests of the pure build run it")
    done = run(text, page.stem, tmp_path)
    assert done.returncode == 0, f"{page}\n{done.stdout}\n{done.stderr}"
    # A page with changes needs a process that imports the changed copy.
    wrong = run_commands(text, tmp_path, None if changes(text) else command_server)
    assert wrong == [], "\n".join([str(page), *wrong])


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_every_block_of_a_page_is_of_a_known_kind(page: Path) -> None:
    assert unknown(page.read_text(encoding="utf-8"), str(page.relative_to(ROOT))) == []


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_files_that_a_page_links_to_exist(page: Path) -> None:
    lines = page.read_text(encoding="utf-8").splitlines()
    for block in blocks("\n".join(lines)):
        lines[block.line - 1 : block.line - 1 + len(block.lines)] = [""] * len(block.lines)
    links = [link for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", "\n".join(lines)) if "://" not in link]
    assert [link for link in links if not (page.parent / link).exists()] == []


def test_every_page_is_in_the_navigation_once_and_the_readme_links_to_the_first() -> None:
    linked = re.findall(r"\]\(([^)]+\.md)\)", NAVIGATION.read_text(encoding="utf-8"))
    written = [page.relative_to(ROOT if page in ROOT_PAGES else ROOT / "docs").as_posix() for page in PAGES]
    assert sorted(linked) == sorted(written)
    assert "(docs/index.md)" in (ROOT / "README.md").read_text(encoding="utf-8")


def unknown(page: str, name: str = "") -> list[str]:
    """Return line and fence of each block of *page* that is of an unknown kind or is an unused file."""
    found = []
    for block in blocks(page):
        match = FILE.fullmatch(block.info)
        if match is not None:
            others = [other.text for other in blocks(page) if other is not block]
            used = re.compile(rf"{re.escape(match[2])}|(import|from) {Path(match[2]).stem}\b")
            known = any(used.search(other) for other in others)
        else:
            known = KINDS.fullmatch(block.info) is not None
            known = known and (
                name == "docs/reference/errors.md" or not re.fullmatch(r"xml [EWC]\d{3}", block.info)
            )
        if not known:
            found.append(f"line {block.line - 1}: {block.info}")
    return found


# --- the runner


def test_blocks_run_in_order_and_share_their_variables(tmp_path: Path) -> None:
    page = "# A page\n```python\na = 1\n```\nThen:\n\n- so\n  ```python\n  print(a + 1)\n  ```\n"
    assert run(page, "page", tmp_path).stdout == "2\n"


def test_blocks_of_other_kinds_do_not_run(tmp_path: Path) -> None:
    page = "```cpp\nnonsense(\n```\n```python unrun: it is wrong\n1 +\n```\n~~~text\n```python\n~~~\n"
    done = run(page, "page", tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert unknown(page) == []


@pytest.mark.parametrize(
    "fence", ["", "pycon", "py", "bash", "xml", "xml E101", "xml unused.xml", "python unrun:", "console no"]
)
def test_a_block_that_would_silently_not_run_is_reported(fence: str) -> None:
    assert unknown(f"One\n```{fence}\n1\n```\n") == [f"line 2: {fence}"]


def test_files_are_written_before_anything_runs(tmp_path: Path) -> None:
    page = "```python\nprint(open('a.xml').read(), end='')\n```\n```xml a.xml\n<a/>\n```\n"
    page += "```console\n$ cat a.xml\n<a/>\n```\n"
    assert run(page, "page", tmp_path).stdout == "<a/>\n"
    assert run_commands(page, tmp_path) == []
    assert unknown(page) == []


def test_a_later_file_replaces_an_earlier_file_for_the_commands_below_it(tmp_path: Path) -> None:
    first, later = "```xml a.xml\n<a/>\n```\n", "```xml a.xml\n<b/>\n```\n"
    page = f"{first}```console\n$ cat a.xml; echo c > a.xml\n<a/>\n$ cat a.xml\nc\n```\n{later}"
    page += "```console\n$ cat a.xml\n<b/>\n```\n"
    run(page, "page", tmp_path)
    assert run_commands(page, tmp_path) == []


@pytest.mark.parametrize(
    ("shown", "fine"),
    [
        ("$ echo one; echo two\none\ntwo", True),
        ("$ echo one; echo two\none", False),
        ("$ echo one; echo two\n…\ntwo", True),
        ("$ echo one; echo two; echo three\n…\nthree", True),
        ("$ echo one; echo two; echo three\none\n…\nthree", True),
        ("$ echo one; echo two\no…\nt…o", True),
        ("$ echo one; echo two\no…", False),
        ("$ echo one; false\none", True),
        ("$ echo one", True),
        ("$ false", False),
        ("$ true\n$ false", False),
        ("$ btcore --version\nbtcore …", True),
        ("$ python -c 'import btcore, sys; sys.exit(3)' || echo $?\n3", True),
    ],
)
def test_command_must_print_what_is_shown_or_succeed(shown: str, fine: bool, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    assert (run_commands(f"```console\n{shown}\n```\n", tmp_path) == []) is fine


@pytest.mark.parametrize(
    ("shown", "fine"),
    [
        ("$ btcore --version\nbtcore …", True),
        ("$ btcore --version\nother", False),
        ("$ btcore validate a.xml", False),
        ("$ btcore validate a.xml || true", True),
        ("$ btcore validate a.xml; test $? = 2", True),
        ("$ btcore --version; test $? = 1", False),
        ("$ btcore validate a.xml\nerror: there is no file 'a.xml';…", True),
        ("$ btcore nodes 'Inverter'\n…\n…Inverter…", True),
        ("$ btcore nodes --no-such-option || echo failed\n…\nfailed", True),
    ],
)
def test_commands_of_the_server_are_checked_as_well(
    shown: str, fine: bool, tmp_path: Path, command_server: CommandServer | None
) -> None:
    (tmp_path / "empty").mkdir()
    assert (run_commands(f"```console\n{shown}\n```\n", tmp_path, command_server) == []) is fine


def test_only_plain_commands_of_btcore_need_no_shell() -> None:
    assert needs_no_shell("btcore run a.xml --set 'goal=1;2|3' --start=-0.5,3 --set \"a=b c\"")
    with_shell = [
        "btcore show a > b",
        "btcore show a; ls",
        "A=1 btcore show",
        "btcore show $A",
        "btcore show *",
    ]
    assert [command for command in [*with_shell, "ls", "btcore sweep a"] if needs_no_shell(command)] == []


def test_a_failing_block_is_reported_with_its_line_in_the_page(tmp_path: Path) -> None:
    done = run("one\n\n```python\na = 1\nassert a == 2\n```\n", "page", tmp_path)
    assert done.returncode == 1
    assert "line 5" in done.stderr


def test_tests_in_a_page_are_run_with_the_fixtures_of_btcore(tmp_path: Path) -> None:
    page = "```python\ndef test_it(btcore_clock):\n    assert btcore_clock.now() == {}\n```\n"
    assert "1 passed" in run(page.format(0), "good", tmp_path).stdout
    shutil.rmtree(tmp_path / "empty")
    assert "1 failed" in run(page.format(1), "bad", tmp_path).stdout


DIFF = """\
```diff
--- btcore/status.py
+++ btcore/status.py
@@ -1,2 +1,2 @@
-{}
+CHANGED = True

```
"""


def test_changes_are_applied_to_a_copy_of_the_repository(tmp_path: Path) -> None:
    source = ROOT / "btcore" / "status.py"
    before = source.read_text(encoding="utf-8")
    page = DIFF.format(before.splitlines()[0])
    page += "```python\nfrom btcore.status import CHANGED\nprint(CHANGED)\n```\n"
    page += "```console\n$ head -n 1 btcore/status.py\nCHANGED = True\n```\n"
    done = run(page, "page", tmp_path)
    assert (done.stdout, done.stderr) == ("True\n", "")
    assert run_commands(page, tmp_path) == []
    assert unknown(page) == []
    assert source.read_text(encoding="utf-8") == before


def test_changes_that_do_not_fit_the_repository_fail(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=r"btcore/status\.py: patch does not apply"):
        run(DIFF.format("Something else."), "page", tmp_path)
