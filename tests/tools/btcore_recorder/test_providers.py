"""Recordings of runs: `btcore run --record`, and `RecordingSettings` in programs."""

from contextlib import suppress
from pathlib import Path

import pytest
from click.testing import CliRunner

import btcore
from btcore import NodeExecutionError, OutputError, Registry, Run, RunSettings
from btcore.cli.main import main
from btcore.program_runner import TreelessProgram
from btcore_recorder import Replay
from btcore_recorder.providers import RecordingSettings

DOCUMENT = '<root BTCPP_format="4"><BehaviorTree ID="Main">{}</BehaviorTree></root>'


OTHER_TREES = """<BehaviorTree ID="Good"><AlwaysSuccess/></BehaviorTree>
<BehaviorTree ID="Bad"><AlwaysFailure/></BehaviorTree>
<BehaviorTree ID="Raises"><OpenDoor angle="3"/></BehaviorTree></root>"""


@btcore.action
def open_door(angle: btcore.In[float]) -> bool:
    """Fail for a negative angle, and raise for a large one."""
    if angle > 2:
        raise ValueError("too wide")
    return angle > 0


NODES = Registry.standard()
NODES.add(open_door)


def run_door(folder: Path, angle: float, **settings: str) -> list[Path]:
    """Run a tree that is recorded, and return the files that are there then."""
    tree = folder / "door.xml"
    leaves = f'<Sleep msec="200"/><OpenDoor angle="{angle}"/>'
    tree.write_text(DOCUMENT.format(f"<Sequence>{leaves}</Sequence>"))
    recording = RecordingSettings(folder / "run.btrec.txt", **settings)  # type: ignore[arg-type]
    with (
        suppress(NodeExecutionError),
        Run(tree, nodes=NODES, settings=[RunSettings(fast=True), recording]) as run,
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


def test_the_end_of_a_run_is_written_if_a_tick_limit_strikes_or_an_assertion_fails(tmp_path: Path) -> None:
    tree = tmp_path / "tree.xml"
    endless = '<Repeat num_cycles="-1"><AlwaysSuccess/></Repeat>'
    for limit, nodes in ((0.01, endless), (None, '<Sleep msec="100"/>')):
        tree.write_text(DOCUMENT.format(nodes))
        file = tmp_path / f"limit_{limit}.btrec.txt"
        settings = [RunSettings(fast=True), RecordingSettings(file, record_on="failure")]
        with (
            suppress(NodeExecutionError, AssertionError),
            Run(tree, settings=settings, tick_limit=limit) as run,
        ):
            run.step()
            assert limit
        replay = Replay(file)
        assert replay.verify() is None
        assert replay.tree.ticks >= 1


def test_a_folder_gets_a_file_for_each_tree_that_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a tree server, which halts each tree at its end."""
    folder, document = tmp_path / "recordings", tmp_path / "tree.xml"
    document.write_text(DOCUMENT.format("<SubTree ID='Good'/>").replace("</root>", "") + OTHER_TREES)
    monkeypatch.setattr("btcore_recorder.files.FOLDER_BYTES", 3000)
    settings = RecordingSettings(folder, record_on="failure")
    with Run(TreelessProgram("Waiting"), settings=[settings]) as run:
        for name in ("Bad", "Good", "Bad", "Bad", "Bad", "Raises"):
            tree = btcore.load(document, tree=name, nodes=NODES)
            run.replace_tree(tree)
            with suppress(NodeExecutionError):
                tree.tick_exactly_once()
            tree.halt()
    files = sorted(folder.iterdir())
    assert 1 < len(files) < 5
    assert sum(file.stat().st_size for file in files[:-1]) <= 3000
    assert "_Raises_" in files[-1].name
    for file in files:
        replay = Replay(file)
        assert replay.verify() is None
        assert replay.tree.ticks == 1


def test_an_interrupted_server_writes_only_the_tree_that_runs(tmp_path: Path) -> None:
    for is_running in (False, True):
        folder, document = tmp_path / f"{is_running}", tmp_path / "tree.xml"
        document.write_text(DOCUMENT.format('<Sleep msec="100"/>'))
        settings = RecordingSettings(folder, record_on="failure")
        with suppress(KeyboardInterrupt), Run(TreelessProgram("Waiting"), settings=[settings]) as run:
            tree = btcore.load(document)
            run.replace_tree(tree)
            tree.tick_exactly_once()
            if not is_running:  # it is cancelled
                tree.halt()
            raise KeyboardInterrupt
        assert len(list(folder.glob("*"))) == is_running


def test_a_recording_that_is_turned_off_writes_nothing(tmp_path: Path) -> None:
    assert not run_door(tmp_path, -1.0, record_on="never")


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
    result = CliRunner().invoke(main, ["run", "door.xml", "--record", "run.txt"], prog_name="btcore")
    assert result.exit_code == 2
    assert "the name of a recording must end in .btrec.txt or .mcap" in result.stderr
