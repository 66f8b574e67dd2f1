"""The sources use nothing that Windows or macOS lacks, except in a branch for the other platforms.

`make lint` finds missing functions and constants: it runs mypy for Windows, too. The test here finds what the
types of the standard library do not show.
"""

import ast
import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SOURCES = [
    ROOT / "setup.py",
    *sorted(
        path
        for folder in ("btcore", "monitor", "robot_nodes", "ros2", "sim", "tools")
        for path in (ROOT / folder).rglob("*.py")
    ),
]

POSIX_MODULES = {
    "curses",
    "fcntl",
    "grp",
    "posix",
    "pty",
    "pwd",
    "readline",
    "resource",
    "syslog",
    "termios",
    "tty",
}
POSIX_TEXT = re.compile(r"/(dev|proc|tmp)(/|$)|ipc://")
POSIX_ARGUMENTS = {"preexec_fn", "pass_fds", "process_group", "umask", "user", "group"}
# Functions that exist on every platform, but raise an error on Windows.
UNSUPPORTED = {"add_signal_handler", "remove_signal_handler", "symlink_to", "symlink", "chown"}
LINUX_ONLY = re.compile(r"(sched|memfd|eventfd|pidfd|epoll|inotify|posix)_\w+|epoll|splice|sendfile|prctl")
MODE = re.compile(r"'[rwax][bt+]*'")
PLATFORM = re.compile(r"\b(sys\.platform|os\.name|hasattr\()")


class Source:
    """A source file: its syntax tree, and the nodes that contain each node."""

    def __init__(self, text: str) -> None:
        self.tree = ast.parse(text)

    @cached_property
    def parents(self) -> dict[ast.AST, ast.AST]:
        return {child: node for node in ast.walk(self.tree) for child in ast.iter_child_nodes(node)}

    @cached_property
    def condition(self) -> re.Pattern[str]:
        """What conditions about the platform contain: also constants of the module that depend on it."""
        constants = [
            ast.unparse(node.targets[0] if isinstance(node, ast.Assign) else node.target)
            for node in self.tree.body
            if isinstance(node, (ast.Assign, ast.AnnAssign)) and PLATFORM.search(ast.unparse(node))
        ]
        return re.compile("|".join([PLATFORM.pattern, *(rf"\b{name}\b" for name in constants)]))

    def is_docstring(self, node: ast.AST) -> bool:
        """Return whether *node* is the value of an expression statement: a docstring."""
        return isinstance(self.parents.get(node), ast.Expr)

    def is_in_branch(self, node: ast.AST) -> bool:
        """Return whether *node* runs only if a condition about the platform holds."""
        while node in self.parents:
            parent = self.parents[node]
            if isinstance(parent, (ast.If, ast.IfExp)) and self.depends_on_platform(parent.test):
                return True
            # A branch above the node that ended the function.
            body = getattr(parent, "body", None)
            before = body[: body.index(node)] if isinstance(body, list) and node in body else []
            if any(map(self.ends_for_a_platform, before)):
                return True
            node = parent
        return False

    def depends_on_platform(self, condition: ast.expr) -> bool:
        return self.condition.search(ast.unparse(condition)) is not None

    def ends_for_a_platform(self, statement: ast.stmt) -> bool:
        return (
            isinstance(statement, ast.If)
            and self.depends_on_platform(statement.test)
            and isinstance(statement.body[-1], (ast.Return, ast.Raise))
        )


def problems(text: str) -> list[str]:
    """Return the line and the kind of each use of something that Windows or macOS lacks."""
    source = Source(text)
    return [
        f"{getattr(node, 'lineno', 0)}: {problem}"
        for node in ast.walk(source.tree)
        for problem in (*posix_uses(source, node), *text_problems(node))
        if not source.is_in_branch(node)
    ]


def posix_uses(source: Source, node: ast.AST) -> Iterator[str]:
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
        yield from (f"import of {name}" for name in names if name.partition(".")[0] in POSIX_MODULES)
    elif isinstance(node, ast.Constant) and isinstance(node.value, str):
        if POSIX_TEXT.match(node.value) and not source.is_docstring(node):
            yield f"path {node.value}"
    elif isinstance(node, ast.Attribute):
        if node.attr in UNSUPPORTED or LINUX_ONLY.fullmatch(node.attr):
            yield node.attr
        if node.attr == "rename":
            yield "rename fails on Windows if the target exists: use replace"
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        name, keywords = node.func.attr, {str(keyword.arg) for keyword in node.keywords}
        if name == "Popen":
            yield from sorted(keywords & POSIX_ARGUMENTS)
            if "start_new_session" in keywords and "creationflags" not in keywords:
                yield "start_new_session without creationflags, which Windows needs"
        elif name in ("get_context", "set_start_method") and "'fork" in ast.unparse(node):
            yield "processes that are forked"
        elif name == "open" and "os.O_" in ast.unparse(node) and "BINARY" not in ast.unparse(node):
            yield "os.open without O_BINARY: Windows translates line ends"


def text_problems(node: ast.AST) -> Iterator[str]:
    """Return the reasons why a text is read or written differently on other platforms."""
    if not isinstance(node, ast.Call):
        return
    is_method = isinstance(node.func, ast.Attribute)
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    if name not in ("open", "read_text", "write_text", "run", "Popen", "check_output"):
        return
    given = {keyword.arg for keyword in node.keywords}
    modes = [value for value in map(ast.unparse, node.args) if MODE.fullmatch(value)]
    if name in ("run", "Popen", "check_output"):
        is_text, writes = bool({"text", "universal_newlines"} & given), False
    elif name in ("read_text", "write_text"):
        is_text, writes = is_method, name == "write_text"
    elif name == "open" and (modes or not is_method or "encoding" in given):
        is_text, writes = "b" not in "".join(modes), not set("wax").isdisjoint("".join(modes))
    else:
        return
    if is_text and "encoding" not in given:
        yield f"{name} of a text without an encoding"
    if is_text and writes and "newline" not in given and "os.devnull" not in map(ast.unparse, node.args):
        yield f"{name} of a text without newline: Windows translates line ends"


def test_sources_are_portable() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{problem}"
        for path in SOURCES
        for problem in problems(path.read_text(encoding="utf-8"))
    ]
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        "import fcntl",
        "from pwd import getpwnam",
        "folder = '/tmp'",
        "socket.bind(f'ipc://{path}')",
        "loop.add_signal_handler(15, stop)",
        "os.sched_getaffinity(0)",
        "subprocess.Popen(command, preexec_fn=prepare)",
        "subprocess.Popen(command, start_new_session=True)",
        "subprocess.run(command, text=True)",
        "multiprocessing.get_context('fork')",
        "os.open(path, os.O_WRONLY)",
        "open(path)",
        "path.read_text()",
        "path.write_text(text, encoding='utf-8')",
        "path.rename(other)",
        "path.open('w', encoding='utf-8')",
        "if answer:\n    import fcntl",
    ],
)
def test_use_of_a_platform_is_found(text: str) -> None:
    assert len(problems(text)) == 1


@pytest.mark.parametrize(
    "text",
    [
        "if sys.platform != 'win32':\n    import fcntl",
        "def limit():\n    if sys.platform == 'win32':\n        return 0\n    import resource",
        "HAS_SOCKETS = hasattr(socket, 'AF_UNIX')\nif HAS_SOCKETS:\n    socket.bind(f'ipc://{path}')",
        "folder = '/tmp' if os.name == 'posix' else None",
        "def read():\n    'Read from /tmp.'",
        "subprocess.Popen(command, start_new_session=True, creationflags=FLAGS)",
        "subprocess.run(command, text=True, encoding='utf-8')",
        "open(path, 'rb')",
        "path.write_text(text, encoding='utf-8', newline='\\n')",
        "os.open(path, os.O_RDONLY | getattr(os, 'O_BINARY', 0))",
    ],
)
def test_branches_and_portable_calls_are_accepted(text: str) -> None:
    assert problems(text) == []
