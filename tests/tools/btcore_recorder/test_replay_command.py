"""`btcore replay`: logs and recordings as text, and recordings that are verified."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import btcore
from btcore.cli.main import main
from btcore.logs import BtLog, read_log
from btcore_recorder import record

CAPTURES = Path(__file__).parents[2] / "btcore" / "logs" / "captures"
LOGS = [CAPTURES / name for name in ("v4_sample.btlog", "v4_sample.db3", "v3_sample.fbl")]
EACH_LOG = pytest.mark.parametrize("log", LOGS, ids=lambda path: path.suffix[1:])

Replay = Callable[..., Result]


@pytest.fixture
def replay(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Replay:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    return lambda *arguments: CliRunner().invoke(main, ["replay", *map(str, arguments)], prog_name="btcore")


def parts(text: str) -> list[tuple[str, str, str]]:
    """(path, old, new) of every line."""
    words = [line.split() for line in text.splitlines()]
    return [(path, old, new) for _, path, old, _, new in words]


@EACH_LOG
def test_text_has_a_line_for_each_transition(replay: Replay, log: Path) -> None:
    recording = read_log(log)
    result = replay(log, "--text")
    assert result.exit_code == 0, result.output
    paths = recording.keys()
    assert parts(result.stdout) == [
        (paths[uid], previous.name, status.name) for _, uid, previous, status in recording.transitions
    ]


def test_both_formats_of_one_run_give_the_same_lines(replay: Replay) -> None:
    first, second = (parts(replay(log, "--text").stdout) for log in LOGS[:2])
    assert first == second


def test_times_count_from_the_start_of_the_log(replay: Replay) -> None:
    lines = replay(LOGS[2], "--text").stdout.splitlines()
    assert lines[5].split() == ["0.305341", "cnt", "RUNNING", "→", "SUCCESS"]


def test_options_select_a_time_span_and_nodes(replay: Replay) -> None:
    result = replay(LOGS[2], "--text", "--from", "0.3", "--to", "0.31", "--node", "Sub*", "--node", "cnt")
    assert [path for path, _, _ in parts(result.stdout)] == [
        "cnt",
        "cnt",
        "Sub::6",
        "Sub::6/Sequence::7",
        "Sub::6/Count::8",
    ]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--text", "--save", "x.rrd"], "--text and --save exclude each other"),
        (["--node", "cnt", "--save", "x.rrd"], "--node selects lines, so it needs --text"),
        (["--text", "--node", "Sub::7"], "no node's path matches 'Sub::7'; did you mean 'Sub::6'?"),
        (["--text", "--from", "3", "--to", "2"], "--from 3 is after --to 2"),
        (
            ["--text", "--from", "99"],
            "there are no transitions in this time range; the transitions are at 0.017 s to",
        ),
        (["--save", "x.txt"], "a recording is an .rrd file"),
        (["--save", "nowhere/x.rrd"], "there is no folder"),
        (["--screenshot", "nowhere/x.png"], "there is no folder"),
    ],
)
def test_a_usage_error_is_reported_with_exit_code_2(replay: Replay, options: list[str], message: str) -> None:
    result = replay(LOGS[0], *options)
    assert result.exit_code == 2
    assert message in result.stderr
    assert "Traceback" not in result.stderr


def test_a_truncated_log_is_shown_up_to_the_truncation(replay: Replay, tmp_path: Path) -> None:
    (tmp_path / "cut.btlog").write_bytes(LOGS[0].read_bytes()[:-5])
    result = replay("cut.btlog", "--text")
    assert result.exit_code == 0
    *lines, last = result.stdout.splitlines()
    assert len(lines) == 56
    assert "the file is truncated within a transition" in last
    assert "56 transitions are read" in result.stderr


def test_a_gap_is_shown_at_its_position(replay: Replay, tmp_path: Path) -> None:
    (tmp_path / "run.btlog").write_bytes(LOGS[0].read_bytes())
    (tmp_path / "run.btlog.gaps").write_text("2 the transitions 3 to 9 are lost\n")
    lines = replay("run.btlog", "--text").stdout.splitlines()
    assert lines[2].strip() == "—  gap: the transitions 3 to 9 are lost"


# --- recordings


@pytest.fixture
def recorded(replay: Replay) -> Path:
    """A recording and a log of the same run."""
    b = btcore.Builder()
    tree = b.build(
        b.Sequence(b.Script(code="n := 1"), b.Sleep(msec="300"), b.ScriptCondition(code="n == 2")),
        clock=btcore.SimClock(),
    )
    with record(tree, "run.btrec.txt") as recorder, BtLog(tree, "run.btlog"):
        tree.tick_while_running(period=0.1)
    return recorder.path


def test_a_recording_has_the_lines_of_a_log_of_the_same_run(replay: Replay, recorded: Path) -> None:
    lines = [replay(f"run{extension}", "--text").stdout for extension in (".btrec.txt", ".btlog")]
    assert lines[0] == lines[1]
    assert "0.300000  ScriptCondition::4     IDLE → FAILURE" in lines[0]


def test_a_recording_is_verified(replay: Replay, recorded: Path) -> None:
    result = replay(recorded, "--verify")
    assert (result.exit_code, result.stdout) == (0, "equal: 4 ticks with 10 transitions\n")
    result = replay(recorded, "--verify", "--json")
    assert json.loads(result.stdout) == {"ticks": 4, "transitions": 10, "equal": True}


def test_the_first_difference_is_explained(replay: Replay, recorded: Path) -> None:
    text = recorded.read_text().replace("300", "200")
    # Without the checksums of lines, as in a file that was written by hand.
    recorded.write_text(re.sub(r"^((head|end) .*?)\d+\]$", r"\1null]", text, flags=re.MULTILINE))
    result = replay(recorded, "--verify")
    assert result.exit_code == 1
    assert result.stdout.splitlines() == [
        "equal: 2 ticks with 3 transitions; then, at 0.200 s, tick 3: recorded: the result is RUNNING; "
        "now: the result is FAILURE",
        "probable cause: the tree changed",
    ]
    data = json.loads(replay(recorded, "--verify", "--json").stdout)
    assert (data["equal"], data["tick"], data["time_s"]) == (False, 3, 0.2)
    assert "the replay differs from the recording at tick 3" in replay(recorded, "--text").stderr


def test_a_run_is_changed(replay: Replay, recorded: Path) -> None:
    text = recorded.read_text()
    tree = "\n".join(line[1:] for line in text.splitlines() if line.startswith("|"))
    Path("edited.xml").write_text(tree.replace("n == 2", "n == 1"))
    result = replay(recorded, "--tree", "edited.xml")
    assert (result.exit_code, result.stdout.splitlines()) == (
        1,
        [
            "it differs from tick 4 on: recorded: 'ScriptCondition::4' becomes FAILURE; "
            "now: 'ScriptCondition::4' becomes SUCCESS",
            "it ends in tick 4 with SUCCESS, because the recording ended",
        ],
    )
    result = replay(recorded, "--set", "n=2@4", "--json")
    data = json.loads(result.stdout)
    assert (data["differs_from"], data["status"], data["same"]) == (4, "SUCCESS", False)
    Path("edited.xml").write_text(tree.replace("ScriptCondition code", 'ScriptCondition name="Check" code'))
    result = replay(recorded, "--tree", "edited.xml", "--match", "ScriptCondition::4=Check")
    assert (result.exit_code, result.stdout.splitlines()[0]) == (0, "the same in all 4 ticks")


def test_all_recordings_in_a_folder_are_run_again(replay: Replay, recorded: Path) -> None:
    Path("runs").mkdir()
    text = recorded.read_text()
    for number in (1, 2):
        Path(f"runs/{number}.btrec.txt").write_text(text)
    Path("runs/3.btrec.txt").write_text("btrec [1]\n")
    result = replay("runs", "--set", "n=2@4")
    assert (result.exit_code, result.stdout.splitlines()) == (
        1,
        [
            "1.btrec.txt  differs from tick 4 on: 'ScriptCondition::4' becomes SUCCESS",
            "2.btrec.txt  differs from tick 4 on: 'ScriptCondition::4' becomes SUCCESS",
            "3.btrec.txt  error: runs/3.btrec.txt: line 1: the head of this recording is damaged: the head "
            "does not end",
            "0 of 3 recordings are the same",
        ],
    )
    Path("runs/3.btrec.txt").unlink()
    result = replay("runs", "--verify", "--json")
    assert [json.loads(line)["equal"] for line in result.stdout.splitlines()] == [True, True]
    assert result.exit_code == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ["run.btrec.txt", "--result", "Sleep::3=F@2"],
            "no node 'Sleep::3' in the tree, whose results are recorded",
        ),
        (
            ["run.btrec.txt", "--result", "Sleep=Q@2"],
            "--result Sleep=Q@2: 'Q' is not a result: use R, S, F or K",
        ),
        (["run.btrec.txt", "--set", "n=2"], "--set n=2: expected NAME=VALUE@TICK, such as door=F@12"),
        (["run.btrec.txt", "--match", "a=b"], "--match needs --tree"),
        (["run.btrec.txt", "--tree", "no.xml"], "no.xml: E003 no such file"),
        (["run.btrec.txt", "--tree", "x.xml", "--text"], "--tree and --text exclude each other"),
        (["run.btlog", "--set", "n=2@1"], "run.btlog is a log of statuses: --set needs a recording"),
        (["run.btlog", "--verify"], "run.btlog is a log of statuses: --verify needs a recording"),
        (["run.btlog", "--json"], "--json needs --verify"),
        (["run.btrec.txt", "--verify", "--text"], "--verify and --text exclude each other"),
        (["missing.btrec.txt", "--verify"], "missing.btrec.txt: cannot read this log: no such file"),
    ],
)
def test_usage_errors_about_recordings(
    replay: Replay, recorded: Path, options: list[str], message: str
) -> None:
    result = replay(*options)
    assert result.exit_code == 2
    assert message in " ".join(result.stderr.split())
