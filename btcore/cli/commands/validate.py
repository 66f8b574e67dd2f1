"""`btcore validate`: report all errors and warnings in tree files, and fix them."""

import difflib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import click
from rich.console import Console
from rich.text import Text

from btcore.blackboard.ports import braced_key
from btcore.cli import files, terminal
from btcore.cli.node_libraries import NodeLibraries
from btcore.cli.tree_source import STDIN, TreeOptions, complete_tree, find_source, given_keys, parse_source
from btcore.diagnostics import Diagnostic, shown_diagnostics
from btcore.errors import TreeError
from btcore.exit_codes import ExitCode
from btcore.field_options import pass_options
from btcore.input_files import read_file, real_path
from btcore.lint.validate import validate_document
from btcore.suggestions import counted
from btcore.xml.edit.quick_fixes import FixMaker, fix_text
from btcore.xml.read.read import parse_file

MAX_ROUNDS: Final = 10
"""Maximum number of times that a file is fixed and checked again: a fix can reveal another problem."""
_BYTE_ORDER_MARK: Final = "\ufeff"


class _FixedFile(NamedTuple):
    """A file with its text before and after its fixes."""

    path: Path
    before: str
    after: str
    fix_count: int


@click.command()
@click.argument("sources", nargs=-1, required=True, metavar="TREE|FOLDER…", shell_complete=complete_tree)
@pass_options(TreeOptions, "options")
@given_keys
@click.option("--strict", is_flag=True, help="Treat warnings as errors.")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object.")
@click.option("--fix", is_flag=True, help="Correct the files, as far as no decision of a person is needed.")
@click.option(
    "--diff",
    is_flag=True,
    help="Print what --fix would change, instead of changing it, and the errors and warnings on stderr.",
)
def validate(
    sources: Sequence[str],
    options: TreeOptions,
    given: Sequence[str],
    strict: bool,
    as_json: bool,
    fix: bool,
    diff: bool,
) -> int:
    """Report all errors and warnings in trees, each with file, line and column.

    Arguments are XML files, - for stdin, names of trees that are bundled with btcore, and folders: all .xml
    files in a folder and its subfolders are checked.

    \b
    Exit codes:
      0  no errors
      2  errors, or with --strict warnings
    """
    if diff and (as_json or fix):
        raise click.UsageError(f"{'--json' if as_json else '--fix'} and --diff cannot be used together.")
    paths = [path for source in sources for path in _find_files(source)]
    if (fix or diff) and STDIN in paths:
        raise click.UsageError(f"{'--fix' if fix else '--diff'} needs a file, not stdin.")
    libraries = NodeLibraries(options.plugins, options.models, options.confined, btcore_on_demand=True)
    given = [braced_key(key) or key for key in given]  # a key may also be given as {key}

    def check(file: Path, text: str | None = None) -> list[Diagnostic]:
        """Return the problems of a file, or of the *text* that replaces its content."""
        try:
            if text is None:
                document = parse_source(file, options.confined)
            else:
                document = parse_file(file, confined=options.confined, unsaved={real_path(file): text})
        except TreeError as error:
            return list(error.diagnostics)
        documents, nodes = libraries.read(document)
        return validate_document(
            documents, nodes=nodes, tree=options.tree, format=options.format, given=given
        )

    fixed = [_fix_file(path, check) for path in paths] if fix or diff else []
    if diff:
        _print_difference(fixed)
    for path, before, after, _ in fixed:
        if fix and before != after:
            files.write(path, after.encode())
    diagnostics = [item for path in paths for item in check(path)]
    diagnostics.sort(key=lambda item: not item.is_error)  # errors first
    valid = not any(strict or item.is_error for item in diagnostics)
    fix_count = sum(file.fix_count for file in fixed) if fix else 0
    if as_json:
        shown, _ = shown_diagnostics(diagnostics)
        data = {
            "ok": valid,
            "files": len(paths),
            "fixed": fix_count,
            "diagnostics": _to_json_data(shown),
            "omitted": len(diagnostics) - len(shown),
        }
        terminal.print_json(data)
    else:
        console = terminal.stderr_console() if diff else terminal.stdout_console()
        _print(console, diagnostics, paths, fix_count, valid)
        terminal.print_notes(libraries.missing_library_notes(diagnostics))
    return ExitCode.SUCCESS if valid else ExitCode.USER_ERROR


def _find_files(source: str) -> list[Path]:
    if not Path(source).is_dir():
        return [find_source(source)]
    paths = sorted(Path(source).rglob("*.xml"))
    if not paths:
        raise click.UsageError(f"the folder '{source}' contains no XML file.")
    return paths


def _fix_file(path: Path, check: Callable[[Path, str], list[Diagnostic]]) -> _FixedFile:
    """Apply the safe fixes of the problems of a file until none is left."""
    try:
        before = read_file(path).decode()
    except (OSError, ValueError):
        return _FixedFile(path, "", "", 0)  # the check reports it
    mark = _BYTE_ORDER_MARK if before.startswith(_BYTE_ORDER_MARK) else ""
    text, count = before.removeprefix(mark), 0
    for _ in range(MAX_ROUNDS):
        own = [item for item in check(path, text) if item.file and real_path(item.file) == real_path(path)]
        text, codes = fix_text(text, own)
        if not codes:
            break
        count += len(codes)
    return _FixedFile(path, before, mark + text, count)


def _print_difference(fixed: Iterable[_FixedFile]) -> None:
    console = terminal.stdout_console()
    styles = {"+": "green", "-": "red", "@": "cyan"}
    for path, before, after, _ in fixed:
        lines = (before.splitlines(keepends=True), after.splitlines(keepends=True))
        for line in difflib.unified_diff(*lines, str(path), str(path)):
            console.print(Text(line.rstrip("\r\n"), style=styles.get(line[0], "")), soft_wrap=True)


def _print(
    console: Console, diagnostics: Sequence[Diagnostic], paths: Sequence[Path], fix_count: int, valid: bool
) -> None:
    if diagnostics:
        terminal.print_diagnostics(diagnostics, console)
        console.print()
    mark = Text("✔ ", style="bold green") if valid else Text("✘ ", style="bold red")
    error_count = sum(item.is_error for item in diagnostics)
    counts = {"file": len(paths), "error": error_count, "warning": len(diagnostics) - error_count}
    parts = [counted(count, noun, zero="no") for noun, count in counts.items()]
    if fix_count:
        parts.append(f"{counted(fix_count, 'problem')} fixed")
    console.print(mark.append(", ".join(parts), style="bold"))
    fixable = {item.file for item in diagnostics if item.file and any(fix.is_safe for fix in item.fixes)}
    # --fix does not change other files, which these include.
    if not set(map(real_path, fixable)).isdisjoint(map(real_path, paths)):
        console.print("  --fix corrects what needs no decision, --diff shows how")


def _to_json_data(diagnostics: Iterable[Diagnostic]) -> list[dict[str, object]]:
    makers: dict[str, FixMaker] = {}
    data: list[dict[str, object]] = []
    for diagnostic in diagnostics:
        fixes: list[dict[str, object]] = []
        if diagnostic.fixes and diagnostic.file and Path(diagnostic.file).is_file():
            if diagnostic.file not in makers:
                makers[diagnostic.file] = FixMaker(read_file(diagnostic.file).decode("utf-8-sig", "replace"))
            maker = makers[diagnostic.file]
            place = maker.lines.place
            fixes = [
                {
                    "title": title,
                    "safe": is_safe,
                    "edits": [
                        {"start": place(start), "end": place(end), "text": text} for start, end, text in edits
                    ],
                }
                for title, edits, is_safe in maker.fixes_of(diagnostic)
            ]
        data.append(
            {
                "code": diagnostic.code,
                "severity": diagnostic.code.severity,
                "url": diagnostic.code.url,
                "message": diagnostic.message,
                "file": diagnostic.file,
                "line": diagnostic.line,
                "column": diagnostic.column,
                "width": diagnostic.width,
                "hint": diagnostic.hint,
                "fixes": fixes,
            }
        )
    return data
