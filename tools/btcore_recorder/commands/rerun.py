"""The options of `btcore replay` that run recordings again, as they are or with changes."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import click

from btcore.cli import files, terminal
from btcore.errors import BtcoreError, SettingsError
from btcore.escaping import escape_controls
from btcore.exit_codes import ExitCode
from btcore.json_text import load_json
from btcore.options import Options, changed_option_names, option
from btcore.registry.outcome_grammar import LETTERS, parse_outcomes
from btcore.suggestions import join_names
from btcore_recorder.excerpts import cut, shrink
from btcore_recorder.files import EXTENSIONS, TEXT, local_file, read_recording, save_recording
from btcore_recorder.saved_tests import describe_failure, source_of_test
from btcore_recorder.verification import Verification, verify
from btcore_recorder.what_if import Change, ChangedRun, SetEntry, SetResult, read_document, run_changed


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
    outcomes: Annotated[
        tuple[str, ...],
        option(
            "With --tree, --result or --set: what a leaf does when nothing more is recorded for it, as in "
            "btcore run. Otherwise the run ends there. Repeatable.",
            metavar="NODE=RRS|F",
        ),
    ] = ()
    save_test: (
        Annotated[
            Path,
            option(
                "Write a test for pytest, and beside it the recorded inputs from --from to --to. It fails as "
                "the run did, until the tree is mended. It runs the tree of --tree; by default that in the "
                "recorded file, if this is below the working directory.",
                metavar="test_NAME.py",
            ),
        ]
        | None
    ) = None
    shrink: Annotated[
        bool, option("With --save-test: remove ticks and inputs as long as the run still fails.")
    ] = False
    json: Annotated[
        bool, option("With --verify, --tree, --result and --set: print a JSON object for each recording.")
    ] = False

    def __post_init__(self) -> None:
        given = changed_option_names(self)
        changes = [name for name in given if name in ("--tree", "--result", "--set")]
        if self.verify and changes:
            raise SettingsError(f"--verify and {changes[0]} exclude each other: choose one.")
        if self.save_test is not None:
            not_in_tests = ("--verify", "--result", "--set", "--outcomes", "--json")
            others = [name for name in given if name in not_in_tests]
            if others:
                raise SettingsError(f"--save-test and {others[0]} exclude each other: choose one.")
            if not (self.save_test.name.startswith("test_") and self.save_test.suffix == ".py"):
                raise SettingsError(f"--save-test {self.save_test}: pytest finds tests in files test_….py.")
        elif self.shrink:
            raise SettingsError("--shrink needs --save-test.")
        if self.match and self.tree is None:
            raise SettingsError("--match needs --tree.")
        if self.outcomes and not changes:
            raise SettingsError("--outcomes needs --tree, --result or --set.")
        if self.json and not self.mode:
            raise SettingsError("--json needs --verify; for a log, use btcore stats LOG --json.")

    @property
    def mode(self) -> str:
        """The first given option that runs a recording again, or ""."""
        given = changed_option_names(self)
        modes = ("--save-test", "--verify", "--tree", "--result", "--set")
        return next((name for name in modes if name in given), "")

    def run(self, log: Path, from_s: float | None, to_s: float | None) -> ExitCode:
        """Run the recording *log*, or each in this folder, again, and print what happens.

        Args:
            log: The recording or the folder.
            from_s: The time (s) at which a saved test begins.
            to_s: The time (s) at which it ends.
        """
        if log.is_dir() and self.save_test is None:
            return self._run_folder(log)
        if not log.name.endswith(EXTENSIONS):
            raise click.UsageError(
                f"{log} is a log of statuses: {self.mode} needs a recording (…{TEXT}) of what the ticks "
                "depended on, as btcore run --record writes it."
            )
        if self.save_test is not None:
            return self._save_test(log, self.save_test, from_s, to_s)
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
        document, outcomes = read_document(self.tree), dict(_outcomes(text) for text in self.outcomes)
        return run_changed(read_recording(log), list(self._changes()), document, self._matches, outcomes)

    def _save_test(self, log: Path, test: Path, from_s: float | None, to_s: float | None) -> ExitCode:
        """Write a test, and the recording that it runs, and print what the test does now."""
        file = test.with_suffix(TEXT)
        for existing in (test, file):
            if existing.exists():
                raise click.UsageError(f"{existing} exists already; --save-test does not overwrite it.")
        recording = read_recording(log)
        if recording.damage:
            terminal.print_warning(f"{log}: {recording.damage}")
        recording = cut(recording, from_s, to_s)
        if self.shrink:
            shrunk = shrink(recording)
            recording = shrunk.recording
            click.echo(str(shrunk))
        recorded = run_changed(recording)
        tree = self.tree or local_file(recording.head.documents[-1][0])
        document = read_document(tree)
        run = recorded if document is None else run_changed(recording, (), document, self._matches)
        problem = "" if run.is_same else str(run)
        if recorded.failure is not None:
            problem = describe_failure(recording, run)
        save_recording(file, recording)
        files.write(test, source_of_test(recording, recorded, test, file, tree, self._matches).encode())
        names = escape_controls(f"wrote {test} and {file}", one_line=True)
        tried = "the recorded tree" if tree is None else str(tree)
        outcome = f"fails: {problem}" if problem else "passes"
        click.echo(f"{names}\n{escape_controls(f'with {tried}, the test now {outcome}')}")
        return ExitCode.SUCCESS

    @property
    def _matches(self) -> dict[str, str]:
        return dict(_halves(text, "--match") for text in self.match)

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


def _outcomes(text: str) -> tuple[str, str]:
    node, outcomes = _halves(text, "--outcomes")
    try:
        parse_outcomes(outcomes)
    except ValueError as error:
        raise click.UsageError(f"--outcomes {text}: {error}") from None
    return node, outcomes


def _halves(text: str, option: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise click.UsageError(f"{option} {text}: '=' is missing")
    return name, value
