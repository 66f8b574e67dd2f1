"""User errors on the command line: each prints one message without a traceback, and exits with 2."""

import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import Result

from btcore.cli import terminal
from tests.btcore.cli.conftest import Cli, TreeFile


def assert_refused(result: Result, *expected: str) -> None:
    """Assert that the result is a user error, and that its message contains all of *expected*."""
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    for words in expected:
        assert words in result.stderr


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("run nowhere.xml", ["there is no file 'nowhere.xml'"]),
        ("show nowhere.xml", ["there is no file 'nowhere.xml'"]),
        ("run tere.xml", ["; did you mean 'tree.xml'?"]),
        ("run bumgpo", ["neither a file nor a tree 'bumgpo'", "; did you mean 'bumpgo'?"]),
        ("run .", ["is a folder; give the path of a file"]),
        ("run tree.xml --tree Mian", ["E108 unknown main tree 'Mian'", "did you mean 'Main'?"]),
        ("run --tree tree.xml", ["missing argument 'TREE'", "note: --tree takes the ID of a tree in a file"]),
        ("run tree.xml --rate 0", ["invalid value for '--rate': 0.0 is not in the range 0<x<=10000."]),
        ("run tree.xml --rate often", ["invalid value for '--rate': 'often' is not a valid float range."]),
        ("run tree.xml --rate nan", ["invalid value for '--rate': nan is not a finite number."]),
        ("run tree.xml --rate inf", ["invalid value for '--rate': inf is not in the range 0<x<=10000."]),
        ("run tree.xml --duration -1", ["invalid value for '--duration': -1.0 is not in the range x>0."]),
        ("run tree.xml --duration nan", ["invalid value for '--duration': nan is not a finite number."]),
        ("run tree.xml --seed -5", ["invalid value for '--seed': -5 is not in the range x>=0."]),
        (
            "run tree.xml --until doen",
            ["invalid value for '--until': 'doen' is not one of 'done', 'success', 'failure', 'never'."],
        ),
        ("run tree.xml --sed 3", ["no such option '--sed'.", "'--seed'"]),
        ("vaildate", ["unknown command 'vaildate'", "; did you mean 'validate'?"]),
    ],
)
def test_invalid_arguments_are_refused(
    cli: Cli, tree_file: TreeFile, arguments: str, expected: list[str]
) -> None:
    tree_file("<AlwaysSuccess/>")
    assert_refused(cli(*arguments.split()), *expected)


@pytest.mark.parametrize("command", ["run", "validate", "show"])
def test_confined_option_refuses_includes_outside_of_folder(cli: Cli, tmp_path: Path, command: str) -> None:
    (tmp_path / "in").mkdir()
    tree = tmp_path / "in" / "t.xml"
    for file, include in (tree, '<include path="../a.xml"/>'), (tmp_path / "a.xml", ""):
        trees = f'<BehaviorTree ID="{file.stem}"><AlwaysSuccess/></BehaviorTree>'
        file.write_text(f'<root main_tree_to_execute="t">{include}{trees}</root>')
    assert cli(command, tree).exit_code == 0
    result = cli(command, "--confined", tree)
    assert result.exit_code == 2
    assert "E007 the included file is outside of the folder" in result.output


def test_option_sets_the_maximum_size_of_files(
    cli: Cli, tree_file: TreeFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    tree = tree_file("<AlwaysSuccess/>")
    assert_refused(cli("--max-file-size", "50", "run", tree), "it is larger than 50 bytes")
    assert cli("run", tree).exit_code == 0
    monkeypatch.setenv("BTCORE_MAX_FILE_SIZE", "50")
    assert_refused(cli("run", tree), "it is larger than 50 bytes")
    assert cli("--max-file-size", "5kB", "run", tree).exit_code == 0
    assert_refused(cli("run", tree), "it is larger than 50 bytes")
    assert_refused(cli("--max-file-size", "big", "run", tree), "'big' is not the size of a file")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("<Sequense><AlwaysSuccess/></Sequense>", ":3:5: E101 unknown node <Sequense>\n"),
        ("<Sequence>", ":4:3: E002 expected </Sequence>, but found </BehaviorTree>\n"),
        ("</Sequence>", ":3:5: E002 expected </BehaviorTree>, but found </Sequence>\n"),
    ],
)
@pytest.mark.parametrize("command", ["run", "show"])
def test_invalid_tree_is_refused(
    cli: Cli, tree_file: TreeFile, command: str, body: str, message: str
) -> None:
    assert_refused(cli(command, tree_file(body)), f"tree.xml{message}")


def test_plugin_import_error_is_reported_with_its_line(cli: Cli, tree_file: TreeFile, tmp_path: Path) -> None:
    broken = tmp_path / "broken.py"
    broken.write_text("import btcore\n\nwheels = 4\nwheels.turn()\n")
    assert_refused(
        cli("run", tree_file("<AlwaysSuccess/>"), "--plugin", broken),
        "broken.py:4",
        "AttributeError: 'int' object has no attribute 'turn'",
    )


@pytest.mark.parametrize("plugin", ["./robot_thigns.py", "robot_thing"])
def test_similar_file_is_suggested_for_a_missing_plugin(
    cli: Cli, tree_file: TreeFile, library: Path, plugin: str
) -> None:
    result = cli("run", tree_file("<AlwaysSuccess/>"), "--plugin", plugin)
    assert_refused(result, "did you mean 'robot_things.py'?")


def test_type_of_a_plugin_that_has_the_name_of_an_installed_type_is_used_with_a_warning(
    cli: Cli, tree_file: TreeFile, tmp_path: Path
) -> None:
    pytest.importorskip("btcore_robot", reason="it registers a type Pose2D")
    (tmp_path / "poses.py").write_text(
        "from btcore import In, action\n"
        "class Pose2D(complex): ...\n"
        "@action\ndef go(goal: In[Pose2D]) -> bool:\n    return goal == 1 + 2j\n"
        "def register(nodes):\n    nodes.add_type(Pose2D, Pose2D)\n    nodes.add(go)\n"
    )
    result = cli("run", tree_file('<Go goal="1+2j"/>'), "--plugin", "poses.py")
    assert result.exit_code == 0
    expected = "warning: the type Pose2D of poses overrides the type Pose2D of btcore_robot\n"
    assert expected in result.stderr


def test_duplicate_plugin_is_refused(cli: Cli, tree_file: TreeFile, library: Path) -> None:
    tree = tree_file("<AlwaysSuccess/>")
    result = cli("run", tree, "--plugin", library, "--plugin", "./robot_things.py")
    assert_refused(result, "error: --plugin ./robot_things.py is given more than once.")
    assert_refused(
        cli("run", tree, "--plugin", library, "--plugin", "btcore.nodes.constant_results"),
        "'AlwaysSuccess' is registered ",
    )


def test_robot_options_for_a_tree_without_a_robot_are_reported(cli: Cli, tree_file: TreeFile) -> None:
    pytest.importorskip("pybullet", reason="the options come with the simulator")
    tree = tree_file("<AlwaysSuccess/>")
    result = cli("run", tree, "--fast", "--gui", "--world", "house", "--fault", "laser:1-2")
    assert result.exit_code == 0
    assert result.stderr.splitlines()[0] == (
        "warning: --world, --gui and --fault have no effect: no leaf needs a Robot"
    )
    assert "warning: --camera has no effect" in cli("run", tree, "--camera", "off").stderr
    assert "warning" not in cli("run", tree, "--bind", "127.0.0.1").stderr


def test_debug_variable_shows_the_traceback(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BTCORE_DEBUG", "1")
    result = cli("run", "nowhere.xml")
    assert result.exit_code == 2
    assert "Traceback" in result.output


WITHOUT_EXTRAS = """
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {"numpy", "zmq", "msgpack", "rerun", "pybullet"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Absent())
from btcore.cli.main import main
main()
"""


def without_extras(*arguments: str | Path) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-c", WITHOUT_EXTRAS, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_engine_alone_runs_a_tree(tree_file: TreeFile) -> None:
    done = without_extras("run", tree_file("<AlwaysSuccess/>"), "--fast")
    assert done.returncode == 0, done.stderr


def test_option_of_a_missing_extra_is_explained(tree_file: TreeFile) -> None:
    done = without_extras("run", tree_file("<AlwaysSuccess/>"), "--save", "out.rrd")
    assert done.returncode == 2
    assert "'--save'" in done.stderr
    assert "pip install 'btcore[monitor]'" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "extra"), [(("monitor", "tcp://localhost:1667"), "monitor"), (("world", "office"), "robot")]
)
def test_command_of_a_missing_extra_is_explained(arguments: tuple[str, ...], extra: str) -> None:
    done = without_extras(*arguments)
    assert done.returncode == 2
    assert f"pip install 'btcore[{extra}]'" in done.stderr
    assert "Traceback" not in done.stderr


def test_one_sentence_names_all_libraries_that_an_extra_installs(tree_file: TreeFile) -> None:
    done = without_extras("validate", tree_file("<Navigate/>"))
    assert done.returncode == 2
    output = " ".join((done.stdout + done.stderr).split())
    assert output.count("pip install") == 1
    assert (
        "node libraries that cannot be loaded were not searched ('nav2', 'navigation', 'robot_nodes', "
        "'ros2' and 'ros2_nav2'): the module 'numpy' is not installed; install it with: "
        "pip install 'btcore[robot]'"
    ) in output


def test_run_without_the_simulator_names_its_extra() -> None:
    pytest.importorskip("pybullet")
    program = WITHOUT_EXTRAS.replace('"numpy", "zmq", "msgpack", "rerun", ', "")
    command = [sys.executable, "-c", program, "run", "bumpgo", "--duration", "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "the module 'pybullet' is not installed; install it with: pip install 'btcore[sim]'" in done.stderr


def test_an_error_that_begins_with_a_name_keeps_its_first_letter(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.print_click_error(click.ClickException("Drive: the node has no port 'gaol'"))
    assert capsys.readouterr().err == "error: Drive: the node has no port 'gaol'\n"


def test_an_error_of_click_begins_with_a_small_letter(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.print_click_error(click.ClickException("No such option '--tree'."))
    assert capsys.readouterr().err == "error: no such option '--tree'.\n"
