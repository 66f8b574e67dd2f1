"""The options of `btcore replay` that run recordings again, as they are or with changes."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import click

from btcore.cli import terminal
from btcore.errors import BtcoreError, SettingsError
from btcore.escaping import escape_controls
from btcore.exit_codes import ExitCode
from btcore.input_files import read_error, read_file
from btcore.json_text import load_json
from btcore.options import Options, option
from btcore.registry.mock_nodes import LETTERS
from btcore.suggestions import join_names
from btcore_recorder.files import EXTENSIONS, TEXT, read_recording
from btcore_recorder.verification import Verification, verify
from btcore_recorder.what_if import Change, ChangedRun, SetEntry, SetResult, run_changed


class RerunOptions(Options):
    """What to do with a recording, or with each recording in a folder.

    Raises:
        SettingsError: Options exclude each other, or a value is invalid.
    """

    verify: Annotated[
        bool,
        option(
            f"Run a recording (…{TEXT}) again in the engine, and compare each tick with what was recorded."
        ),
    ] = False
    tree: (
        Annotated[
            Path,
            option(
                "What if the tree had been this one: run it on what the leaves of a recording did.",
                metavar="FILE.xml",
            ),
        ]
        | None
    ) = None
    result: Annotated[
        tuple[str, ...],
        option(
            "What if a leaf had returned S, F, R or K (SKIPPED) in this tick. Repeatable.",
            metavar="NODE=S@TICK",
        ),
    ] = ()
    set: Annotated[
        tuple[str, ...],
        option(
            "What if an entry of the main tree had been set before this tick. Repeatable.",
            metavar="KEY=VALUE@TICK",
        ),
    ] = ()
    match: Annotated[
        tuple[str, ...],
        option(
            "With --tree: the node OLD of the recorded tree is NEW in this tree. Repeatable.",
            metavar="OLD=NEW",
        ),
    ] = ()
    json: Annotated[
        bool, option("With --verify, --tree, --result and --set: print a JSON object for each recording.")
    ] = False

    def __post_init__(self) -> None:
        changes = [f"--{name}" for name in ("tree", "result", "set") if getattr(self, name)]
        if self.verify and changes:
            raise SettingsError(f"--verify and {changes[0]} exclude each other: choose one.")
        if self.match and self.tree is None:
            raise SettingsError("--match needs --tree.")
        if self.json and not self.mode:
            raise SettingsError("--json needs --verify; for a log, use btcore stats LOG --json.")

    @property
    def mode(self) -> str:
        """The first given option that runs a recording again, or ""."""
        given = (name for name in ("verify", "tree", "result", "set") if getattr(self, name))
        return next((f"--{name}" for name in given), "")

    def run(self, log: Path) -> ExitCode:
        """Run the recording *log*, or each in this folder, again, and print what happens."""
        if log.is_dir():
            return self._run_folder(log)
        if not log.name.endswith(EXTENSIONS):
            raise click.UsageError(
                f"{log} is a log of statuses: {self.mode} needs a recording (…{TEXT}) of what the ticks "
                "depended on, as btcore run --record writes it."
            )
        outcome = self._run_file(log)
        if self.json:
            terminal.print_json(outcome.as_data())
        else:
            click.echo(escape_controls(str(outcome)))
        return ExitCode.SUCCESS if outcome.is_same else ExitCode.FAILURE

    def _run_folder(self, folder: Path) -> ExitCode:
        """Run each recording in *folder* again, and print a line for each."""
        names = [path for path in sorted(folder.rglob("*")) if path.name.endswith(EXTENSIONS)]
        if not names:
            raise click.UsageError(f"{folder}: there is no recording (…{TEXT}) in this folder.")
        differing = 0
        for name in names:
            try:
                outcome = self._run_file(name)
                data, text, is_same = outcome.as_data(), outcome.short_text, outcome.is_same
            except BtcoreError as error:
                data, text, is_same = {"error": str(error)}, f"error: {error}", False
            differing += not is_same
            if self.json:
                terminal.print_json({"recording": str(name), **data})
            else:
                click.echo(escape_controls(f"{name.relative_to(folder)}  {text}", one_line=True))
        if not self.json:
            click.echo(f"{len(names) - differing} of {len(names)} recordings are the same")
        return ExitCode.FAILURE if differing else ExitCode.SUCCESS

    def _run_file(self, log: Path) -> Verification | ChangedRun:
        if self.verify:
            return verify(log)
        document = None if self.tree is None else (str(self.tree), _read_tree(self.tree))
        matches = dict(_halves(text, "--match") for text in self.match)
        return run_changed(read_recording(log), list(self._changes()), document, matches)

    def _changes(self) -> Iterator[Change]:
        for text in self.result:
            node, letter, tick = _parts(text, "--result")
            if letter not in LETTERS:
                choices = join_names(LETTERS, "or")
                raise click.UsageError(f"--result {text}: '{letter}' is not a result: use {choices}")
            yield SetResult(tick, node, LETTERS[letter])
        for text in self.set:
            key, value, tick = _parts(text, "--set")
            decoded: Any = value
            with suppress(ValueError):  # a text
                decoded = load_json(value)
            yield SetEntry(tick, key, decoded)


def _parts(text: str, option: str) -> tuple[str, str, int]:
    """Return the parts of NAME=VALUE@TICK."""
    rest, _, tick = text.rpartition("@")
    name, value = _halves(rest, option) if rest else ("", "")
    if not (name and tick.isdecimal()):
        raise click.UsageError(f"{option} {text}: expected NAME=VALUE@TICK, such as door=F@12")
    return name, value, int(tick)


def _halves(text: str, option: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise click.UsageError(f"{option} {text}: '=' is missing")
    return name, value


def _read_tree(path: Path) -> str:
    try:
        return read_file(path).decode("utf-8-sig")
    except OSError as error:
        reason = read_error(error)
    except UnicodeDecodeError as error:
        reason = str(error)
    raise click.ClickException(f"--tree {path}: {reason}")
