"""Seeds and parameters on the command line of a sweep, and errors in them."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import click
import pytest
from click.testing import Result

from btcore_sweep import parameters
from btcore_sweep.parameters import ParameterOptions

CHOICES = ParameterOptions(
    {
        "battery": click.Option(["--battery"]),
        "fault": click.Option(["--fault"], multiple=True),
        "wild": click.Option(["--wild"], is_flag=True),
    },
    {"seed": "the seeds of a sweep are its --seeds"},
)


class CountedText(str):
    """A text that counts how often its instances are compared."""

    compared = 0

    def __hash__(self) -> int:
        return super().__hash__()

    def __eq__(self, other: object) -> bool:
        CountedText.compared += 1
        return super().__eq__(other)


def test_duplicates_are_found_without_comparing_all_pairs() -> None:
    values = [CountedText(number) for number in range(1000)]
    assert parameters.find_duplicates([*values, CountedText(7)]) == ["7"]
    assert CountedText.compared < len(values)


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("3", (0, 1, 2)),
        ("5..7", (5, 6, 7)),
        ("7..7", (7,)),
        ("3, 17,4", (3, 17, 4)),
        ("1..3,9", (1, 2, 3, 9)),
    ],
)
def test_seeds_are_a_count_a_range_or_a_list(text: str, meant: tuple[int, ...]) -> None:
    assert parameters.parse_seeds(text) == meant
    assert parameters.parse_seeds(parameters.format_seeds(meant)) == meant


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0", "a sweep needs at least one seed"),
        ("9..5", "9..5 descends; write 5..9"),
        ("ten", "'ten' is not a seed"),
        ("-3", "'-3' is not a seed"),
        ("1,2,1", "1 is listed more than once"),
        ("0..99999999999", "seeds exceed the limit of 10000000"),
    ],
)
def test_invalid_seeds_are_reported(text: str, message: str) -> None:
    with pytest.raises(click.UsageError, match=re.escape(message)):
        parameters.parse_seeds(text)


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("battery=20,100", ("20", "100")),
        ("battery=20..100:40", ("20", "60", "100")),
        ("battery=0.1..0.3:0.1,9", ("0.1", "0.2", "0.3", "9")),
        ("battery=-2..0", ("-2", "-1", "0")),
        ("bb.goal=1;2,3;4", ("1;2", "3;4")),
        ('bb.poses="1,2","3,4"', ("1,2", "3,4")),
        ("fault=,laser:5-9", ("", "laser:5-9")),
    ],
)
def test_parameter_values_are_a_list_with_ranges(text: str, meant: tuple[str, ...]) -> None:
    (values,) = parameters.parse_parameters([text], CHOICES).values()
    assert values == meant


def test_several_parameters_make_a_grid_and_become_arguments_of_run() -> None:
    varied = parameters.parse_parameters(["bb.x=1..2", "fault=,laser:5-9", "wild=no,yes"], CHOICES)
    combinations = parameters.combinations(varied)
    assert [parameters.combination_arguments(values, CHOICES) for values in combinations] == [
        ["--set", "x=1"],
        ["--set", "x=1", "--wild"],
        ["--set", "x=1", "--fault", "laser:5-9"],
        ["--set", "x=1", "--fault", "laser:5-9", "--wild"],
        ["--set", "x=2"],
        ["--set", "x=2", "--wild"],
        ["--set", "x=2", "--fault", "laser:5-9"],
        ["--set", "x=2", "--fault", "laser:5-9", "--wild"],
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("battery", "is invalid: write KEY=VALUES"),
        ("batery=1", "'btcore run' has no option --batery; did you mean 'battery'?"),
        ("seed=1..5", "the seeds of a sweep are its --seeds"),
        ("battery=9..5", "9..5 descends"),
        ("battery=1..5:0", "the step must be greater than 0"),
        ("battery=1,2,1", "'1' is listed more than once"),
        ('bb.x="1,2', "a double quote is not closed"),
        ("bb.=1", "the name of the entry is missing"),
    ],
)
def test_invalid_parameter_is_reported(text: str, message: str) -> None:
    with pytest.raises(click.UsageError, match=re.escape(message)):
        parameters.parse_parameters([text], CHOICES)


def test_parameter_given_twice_is_reported() -> None:
    with pytest.raises(click.UsageError, match="list all values in one --param"):
        parameters.parse_parameters(["battery=1", "battery=2"], CHOICES)


def test_flag_accepts_only_true_and_false() -> None:
    with pytest.raises(click.UsageError, match="is a flag; use true or false"):
        parameters.combination_arguments({"wild": "perhaps"}, CHOICES)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--seeds", "3", "--param", "untl=done"], "; did you mean 'until'?"),
        (["--seeds", "3", "--log", "run.btlog"], "no option '--log': it applies to a single run"),
        (["--seeds", "3", "--param", "until=done,soon"], "'soon' is not one of"),
        (
            ["--seeds", "3", "--param", "rate=5", "--rate", "9"],
            "--rate and --param rate=… cannot be used together",
        ),
        (["--seeds", "3", "--param", "watch=true"], "episodes cannot wait for a file to be saved"),
        (["--seeds", "3", "--success-if", "status =="], "--success-if"),
        (
            ["--seeds", "3", "--workers", "2", "--scheduler", "tcp://x:1"],
            "--workers and --scheduler cannot be used together",
        ),
        (["--seeds", "3", "--fast"], "--fast"),
        (["--seeds", "3", "--monitor"], "--monitor"),
        ([], "--seeds"),
    ],
)
def test_usage_error_exits_with_2_before_any_worker_starts(
    sweep: Callable[..., Result], tree: Callable[[str], str], words: list[str], message: str
) -> None:
    result = sweep(tree("<AlwaysSuccess/>"), *words)
    assert result.exit_code == 2
    assert message in " ".join(result.stderr.split())


@pytest.mark.parametrize("module", ["distributed", "pyarrow"])
def test_missing_extra_is_reported_with_the_install_command(
    sweep: Callable[..., Result],
    tree: Callable[[str], str],
    monkeypatch: pytest.MonkeyPatch,
    folder: Path,
    module: str,
) -> None:
    monkeypatch.setitem(sys.modules, module, None)  # Python's mark for a module that is missing
    result = sweep(tree("<AlwaysSuccess/>"), "--seeds", "3", "--format", "parquet")
    assert result.exit_code == 2
    message = " ".join(result.stderr.split())
    assert f"'sweep' requires an optional dependency: the module '{module}' is not installed" in message
    assert "pip install 'btcore[sweep]'" in message
    assert not (folder / "tree.sweep").exists()


def test_engine_and_command_line_do_not_import_the_extra() -> None:
    guests = "{'dask', 'distributed', 'pyarrow'}"
    imports = "import sys; import btcore.cli.main, btcore.cli.commands.run"
    program = f"{imports}; print({guests} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_error_in_tree_has_a_suggestion(sweep: Callable[..., Result], tree: Callable[[str], str]) -> None:
    result = sweep(tree("<AlwaysSucess/>"), "--seeds", "3")
    assert result.exit_code == 2
    assert "did you mean <AlwaysSuccess>?" in result.stderr
