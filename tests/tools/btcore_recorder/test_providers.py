"""Recordings of runs: `btcore run --record`, and `RecordingSettings` in programs."""

from contextlib import suppress
from pathlib import Path

import pytest
from click.testing import CliRunner

import btcore
from btcore import NodeExecutionError, OutputError, Registry, Run, RunSettings
from btcore.cli.main import main
from btcore_recorder import Replay
from btcore_recorder.providers import RecordingSettings

DOCUMENT = '<root BTCPP_format="4"><BehaviorTree ID="Main">{}</BehaviorTree></root>'


@btcore.action
def open_door(angle: btcore.In[float]) -> bool:
    """Fail for a negative angle, and raise for a large one."""
    if angle > 2:
        raise ValueError("too wide")
    return angle > 0


def run_door(folder: Path, angle: float, **settings: str) -> list[Path]:
    """Run a tree that is recorded, and return the files that are there then."""
    tree, nodes = folder / "door.xml", Registry.standard()
    nodes.add(open_door)
    leaves = f'<Sleep msec="200"/><OpenDoor angle="{angle}"/>'
    tree.write_text(DOCUMENT.format(f"<Sequence>{leaves}</Sequence>"))
    recording = RecordingSettings(folder / "run.btrec.txt", **settings)  # type: ignore[arg-type]
    with (
        suppress(NodeExecutionError),
        Run(tree, nodes=nodes, settings=[RunSettings(fast=True), recording]) as run,
    ):
        run.tick_to_end()
    return sorted(folder.glob("*.btrec.txt"))


def test_a_run_is_recorded(tmp_path: Path) -> None:
    [file] = run_door(tmp_path, 1.0)
    replay = Replay(file)
    assert replay.seek(tick=3)
    assert replay.tree.status is btcore.SUCCESS
    assert replay.verify() is None


@pytest.mark.parametrize(("angle", "is_written"), [(1.0, False), (-1.0, True), (3.0, True)])
def test_the_end_of_a_run_is_written_if_it_fails(tmp_path: Path, angle: float, is_written: bool) -> None:
    files = run_door(tmp_path, angle, record_on="failure")
    assert len(files) == is_written
    for file in files:
        replay = Replay(file)
        assert replay.verify() is None
        assert replay.tree.ticks == 3


def test_a_tree_that_replaces_another_has_its_own_recording(tmp_path: Path) -> None:
    tree = tmp_path / "door.xml"
    tree.write_text(DOCUMENT.format("<AlwaysSuccess/>"))
    with Run(tree, settings=[RecordingSettings(tmp_path / "run.btrec.txt")]) as run:
        run.step()
        run.replace_tree(btcore.load(tree))
        run.step()
        run.step()
    # With the halt at the end.
    assert [len(Replay(tmp_path / name).steps) for name in ("run.btrec.txt", "run.2.btrec.txt")] == [
        1,
        3,
    ]  # and the halt


def test_a_tree_that_cannot_be_recorded_continues_after_a_reload(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    tree = tmp_path / "door.xml"
    tree.write_text(DOCUMENT.format("<AlwaysSuccess/>"))
    unrecordable = btcore.load(tree)
    unrecordable.documents = ()
    run = Run(tree, settings=[RecordingSettings(tmp_path / "run.btrec.txt")])
    run.__enter__()
    run.replace_tree(unrecordable)
    assert run.step() is btcore.SUCCESS
    with pytest.raises(OutputError, match=r"recordings are incomplete: .*run\.2\.btrec\.txt"):
        run.__exit__(None, None, None)
    assert "is not from a document" in caplog.text


def test_the_command_line_records(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("door.xml").write_text(DOCUMENT.format("<AlwaysFailure/>"))
    command = ["run", "door.xml", "--record", "run.btrec.txt"]
    for options in ([], ["--record-on", "failure"]):
        result = CliRunner().invoke(main, [*command, *options], prog_name="btcore")
        assert result.exit_code == 1, result.stderr
        assert Replay("run.btrec.txt").verify() is None
        Path("run.btrec.txt").unlink()
    result = CliRunner().invoke(main, ["run", "door.xml", "--record", "run.mcap"], prog_name="btcore")
    assert result.exit_code == 2
    assert "the name of a recording must end in .btrec.txt" in result.stderr
