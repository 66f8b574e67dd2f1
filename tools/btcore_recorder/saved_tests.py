"""Tests that run a recording again: the assertions, and the source code of a test."""

import re
import warnings
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from btcore.clock import NS_PER_S
from btcore.logs.files import LogError
from btcore.status import FAILURE, IDLE
from btcore.suggestions import join_names
from btcore.testing.source_of_tests import LINE_LENGTH, docstring_lines, literal, path_expression
from btcore_recorder.files import read_recording
from btcore_recorder.inputs import RunRecording
from btcore_recorder.what_if import ChangedRun, File, read_document, run_changed


def assert_does_not_fail(
    recording: File, tree: File | None = None, matches: Mapping[str, str] | None = None
) -> None:
    """Run a recording again, and assert that the tree does not fail, and that no node raises.

    `btcore replay --save-test` writes tests with this assertion. The leaves do what was recorded, matched by
    path. If the tree needs a result that was not recorded, for example that of a new leaf, the run ends with
    a warning; this is an error before the tick in which the recorded run failed, or if recorded leaves are
    missing.

    Args:
        recording: The file of the recording.
        tree: The XML file of the tree; by default the recorded tree.
        matches: For leaves that have another path in this tree: the new path by the recorded path.

    Raises:
        AssertionError: The run fails, or ends too early to know.
        LogError: The recording cannot be read, is damaged or invalid.
        TreeError: The tree has errors.
        BtcoreError: There is no such leaf.

    Examples:
        >>> import btcore
        >>> from btcore_recorder import assert_does_not_fail, record
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Inverter(b.AlwaysSuccess(name="door")))
        >>> with record(tree, "run.btrec.txt"):
        ...     _ = tree.tick_once()
        >>> assert_does_not_fail("run.btrec.txt")
        Traceback (most recent call last):
            ...
        AssertionError: the tree fails in tick 1, because of 'Inverter::1'
    """
    __tracebackhide__ = True  # pytest shows the test instead of this function
    recorded = _read(recording)
    run = run_changed(recorded, document=read_document(tree), matches=matches)
    if problem := describe_failure(recorded, run):
        raise AssertionError(problem)
    if run.end == "no result is recorded":
        warnings.warn(
            f"the run ends in tick {run.ticks}, because no result is recorded for '{run.ended_at}': what "
            "follows is not tested",
            stacklevel=2,
        )


def assert_runs_as_recorded(
    recording: File, tree: File | None = None, matches: Mapping[str, str] | None = None
) -> None:
    """Run a recording again, and assert that every transition is as recorded.

    `btcore replay --save-test` writes tests with this assertion. The leaves do what was recorded, matched by
    path.

    Args:
        recording: As in `assert_does_not_fail`.
        tree: As in `assert_does_not_fail`.
        matches: As in `assert_does_not_fail`.

    Raises:
        AssertionError: The run differs from the recording.
        LogError: As in `assert_does_not_fail`.
        TreeError: As in `assert_does_not_fail`.
        BtcoreError: As in `assert_does_not_fail`.

    Examples:
        >>> import btcore
        >>> from btcore_recorder import assert_runs_as_recorded, record
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Inverter(b.AlwaysFailure(name="door")))
        >>> with record(tree, "run.btrec.txt"):
        ...     _ = tree.tick_once()
        >>> assert_runs_as_recorded("run.btrec.txt")
    """
    __tracebackhide__ = True
    recorded = _read(recording)
    run = run_changed(recorded, document=read_document(tree), matches=matches)
    if not run.is_same:
        raise AssertionError(str(run))


def describe_failure(recording: RunRecording, run: ChangedRun) -> str:
    """Return why a run does not show that the tree does not fail, or ""."""
    if run.failure is not None:
        return str(run.failure)
    failed = (step.tick for step in recording.steps if step.tick and step.status in (FAILURE, IDLE))
    failed_in = next(failed, 0)
    if run.end == "no result is recorded" and (run.ticks < failed_in or run.unmatched):
        unmatched = join_names([f"'{path}'" for path in run.unmatched], "and")
        removed = f", and the tree has no {unmatched}, whose results are recorded" if unmatched else ""
        return (
            f"the run ends in tick {run.ticks} (the recorded failure is in tick {failed_in}), because no "
            f"result is recorded for '{run.ended_at}'{removed}: if a node was renamed, pass "
            "matches={old path: new path}; otherwise record the run again"
        )
    return ""


def _read(path: File) -> RunRecording:
    recording = read_recording(Path(path))
    if recording.damage:
        raise LogError(f"{path}: the recording is damaged: {recording.damage}")
    return recording


def source_of_test(
    recording: RunRecording,
    recorded: ChangedRun,
    test: Path,
    file: Path,
    tree: Path | None,
    matches: Mapping[str, str],
    saved_by: str = "btcore replay --save-test",
) -> str:
    """Return the source code of a test that passes or fails as the recorded run did.

    Args:
        recording: The recording.
        recorded: What it did.
        test: The file of the test. Paths in the test are relative to its folder.
        file: The file of the recording.
        tree: The file of the tree; None for the recorded tree.
        matches: As in `assert_does_not_fail`.
        saved_by: The command that saves the test.
    """
    ticks = [step.tick for step in recording.steps if step.tick]
    began = _date(recording.head.wall_time)
    about = [f"A recorded run of '{recording.head.tree_id}'{began}, ticks {ticks[0]} to {ticks[-1]}."]
    if recorded.failure is None:
        assertion = "assert_runs_as_recorded"
        about.append("The test fails if the tree does anything else.")
    else:
        assertion = "assert_does_not_fail"
        about += [f"What happened: {recorded.failure}.", "The test fails until the tree is mended."]
    arguments = [f"FOLDER / {literal(file.name)}"]
    if tree is not None:
        arguments.append(f"tree={path_expression(tree, test.parent)}")
    if matches:
        arguments.append(
            f"matches={{{', '.join(f'{literal(old)}: {literal(new)}' for old, new in matches.items())}}}"
        )
    call = [f"    {assertion}({', '.join(arguments)})"]
    if len(call[0]) > LINE_LENGTH:
        call = [f"    {assertion}(", *(f"        {argument}," for argument in arguments), "    )"]
    first, *others = [line for text in about for line in docstring_lines(text)]
    lines = [
        f'"""{first}',
        "",
        *others,
        "",
        f"Saved by `{saved_by}`.",
        '"""',
        "",
        "from pathlib import Path",
        "",
        f"from btcore_recorder import {assertion}",
        "",
        "FOLDER = Path(__file__).parent",
        "",
        "",
        f"def {_function_name(test)}() -> None:",
        *call,
    ]
    return "\n".join(lines) + "\n"


def _date(wall_time: int) -> str:
    try:
        return f" on {datetime.fromtimestamp(wall_time // NS_PER_S, UTC):%Y-%m-%d at %H:%M:%S} UTC"
    except (OverflowError, ValueError, OSError):  # a stranger's
        return ""


def _function_name(test: Path) -> str:
    return re.sub(r"[^a-zA-Z0-9]+", "_", test.stem)
