"""User errors on the command line: each prints one message without a traceback, and exits with 2."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

Cli = Callable[..., Result]
TreeFile = Callable[..., Path]


def refused(result: Result, *expected: str) -> None:
    """Assert that the result is a user error, and that its message contains all of *expected*."""
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    for words in expected:
        assert words in result.stderr


def test_no_such_file(cli: Cli) -> None:
    refused(cli("run", "nowhere.xml"), "there is no file 'nowhere.xml'")


def test_a_mistyped_file_beside_the_one_that_is_meant(cli: Cli, tree_file: TreeFile) -> None:
    tree_file("<AlwaysSuccess/>", "patrolling.xml")
    refused(cli("run", "patroling.xml"), "Did you mean 'patrolling.xml'?")


def test_a_mistyped_name_of_a_tree_that_comes_with_btcore(cli: Cli) -> None:
    refused(cli("run", "bumgpo"), "neither a file nor a tree 'bumgpo'", "Did you mean 'bumpgo'?")


def test_a_folder(cli: Cli, tmp_path: Path) -> None:
    refused(cli("run", tmp_path), "is a folder; give the path of a file")


BAD_DOCUMENTS = {
    "empty": ("", ": E001"),
    "not XML": ("hello\n", ":1:1: E"),
    "not closed": ('<root BTCPP_format="4">\n  <BehaviorTree ID="M">\n</root>', ":3:1: E"),
    "a bomb of entities": (
        '<!DOCTYPE b [<!ENTITY a "aaaa"><!ENTITY c "&a;&a;">]>\n<root><BehaviorTree ID="&c;"/></root>',
        ":1:1: E",
    ),
    "an external entity": (
        '<!DOCTYPE b [<!ENTITY e SYSTEM "file:///etc/passwd">]>\n<root>&e;</root>',
        ":1:1: E",
    ),
}


@pytest.mark.parametrize("kind", BAD_DOCUMENTS)
def test_a_file_that_is_no_tree(cli: Cli, tmp_path: Path, kind: str) -> None:
    text, place = BAD_DOCUMENTS[kind]
    file = tmp_path / "bad.xml"
    file.write_text(text, encoding="utf-8")
    refused(cli("run", file), f"bad.xml{place}")


BAD_TREES = {
    "an unknown node": ("<Sequense><AlwaysSuccess/></Sequense>", ":3:5: E", "<Sequence>"),
    "an unknown port": ('<Delay delay_mesc="5"><AlwaysSuccess/></Delay>', ":3:12: E", "delay_msec"),
    "a wrong type": ('<Delay delay_msec="soon"><AlwaysSuccess/></Delay>', ":3:24: E", "soon"),
    "a missing subtree": ('<SubTree ID="Mian"/>', ":3:", "Mian"),
    "a recursion": ('<SubTree ID="Main"/>', ":3:", "Main"),
    "no child": ("<Inverter/>", ":3:5: E", "Inverter"),
    "too many children": ("<Inverter><AlwaysSuccess/><AlwaysSuccess/></Inverter>", ":3:", "Inverter"),
}


@pytest.mark.parametrize("kind", BAD_TREES)
@pytest.mark.parametrize("command", ["run", "show"])
def test_a_tree_that_cannot_be_made(cli: Cli, tree_file: TreeFile, command: str, kind: str) -> None:
    body, place, word = BAD_TREES[kind]
    refused(cli(command, tree_file(body)), f"tree.xml{place}", word)


def test_a_script_that_cannot_be_parsed(cli: Cli, tree_file: TreeFile) -> None:
    refused(cli("run", tree_file('<Script code="a := (1 + "/>')), "tree.xml:3:", "E206")


def test_a_tree_id_that_the_file_does_not_hold(cli: Cli, tree_file: TreeFile) -> None:
    refused(cli("run", tree_file("<AlwaysSuccess/>"), "--tree", "Mian"), "Mian", "Main")


def test_a_plugin_that_raises_on_import_is_named_with_exception_and_line(
    cli: Cli, tree_file: TreeFile, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.py"
    broken.write_text("import btcore\n\nwheels = 4\nwheels.turn()\n")
    refused(
        cli("run", tree_file("<AlwaysSuccess/>"), "--plugin", broken),
        "broken.py",
        "AttributeError: 'int' object has no attribute 'turn'",
        "4",
    )


def test_a_plugin_with_a_syntax_error(cli: Cli, tree_file: TreeFile, tmp_path: Path) -> None:
    broken = tmp_path / "broken.py"
    broken.write_text("import btcore\ndef f(:\n")
    refused(cli("run", tree_file("<AlwaysSuccess/>"), "--plugin", broken), "broken.py", "SyntaxError", "2")


def test_a_plugin_that_does_not_exist(cli: Cli, tree_file: TreeFile) -> None:
    tree = tree_file("<AlwaysSuccess/>")
    refused(cli("run", tree, "--plugin", "no_such_library"), "no_such_library")
    refused(cli("run", tree, "--plugin", "missing/things.py"), "missing/things.py")


def test_a_plugin_without_a_name(cli: Cli, tree_file: TreeFile) -> None:
    refused(
        cli("run", tree_file("<AlwaysSuccess/>"), "--plugin", ""),
        "error: a plugin has no name: give the name of a module",
    )


def test_a_plugin_that_is_given_twice(cli: Cli, tree_file: TreeFile, library: Path) -> None:
    tree = tree_file("<AlwaysSuccess/>")
    result = cli("run", tree, "--plugin", library, "--plugin", "./robot_things.py")
    refused(result, "error: --plugin ./robot_things.py is given more than once.")
    refused(
        cli("run", tree, "--plugin", library, "--plugin", "btcore.nodes.constant_results"),
        "'AlwaysSuccess' is registered ",
    )


def test_options_of_a_robot_for_a_tree_without_one_are_told_of(cli: Cli, tree_file: TreeFile) -> None:
    pytest.importorskip("pybullet", reason="the options come with the simulator")
    tree = tree_file("<AlwaysSuccess/>")
    result = cli("run", tree, "--fast", "--gui", "--world", "house", "--fault", "laser:1-2")
    assert result.exit_code == 0
    assert result.stderr.splitlines()[0] == (
        "warning: --world, --gui and --fault have no effect: the tree has no leaf that needs a robot"
    )
    assert "warning: --camera has no effect" in cli("run", tree, "--camera", "off").stderr
    assert "warning" not in cli("run", tree, "--bind", "127.0.0.1").stderr


def test_a_resource_that_nobody_has(cli: Cli, tree_file: TreeFile, tmp_path: Path) -> None:
    plugin = tmp_path / "needy.py"
    plugin.write_text(
        "from btcore import action\n\nclass Submarine: pass\n\n@action\ndef dive(boat: Submarine) -> bool:\n"
        "    return True\n"
    )
    refused(cli("run", tree_file("<Dive/>"), "--plugin", plugin), "Dive", "Submarine")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--rate", "0"], "--rate"),
        (["--rate", "often"], "--rate"),
        (["--duration", "-1"], "--duration"),
        (["--until", "doen"], "done"),
        (["--sed", "3"], "--seed"),
    ],
)
def test_an_option_that_makes_no_sense(
    cli: Cli, tree_file: TreeFile, arguments: list[str], expected: str
) -> None:
    refused(cli("run", tree_file("<AlwaysSuccess/>"), *arguments), expected)


def test_a_mistyped_command(cli: Cli) -> None:
    refused(cli("vaildate"), "unknown command 'vaildate'", "Did you mean 'validate'?")


def test_debug_shows_the_traceback(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_without_the_extra_its_option_is_explained(tree_file: TreeFile) -> None:
    done = without_extras("run", tree_file("<AlwaysSuccess/>"), "--save", "out.rrd")
    assert done.returncode == 2
    assert "'--save'" in done.stderr
    assert "pip install 'btcore[monitor]'" in done.stderr
    assert "Traceback" not in done.stderr


def test_without_the_extra_its_command_is_explained() -> None:
    done = without_extras("monitor", "tcp://localhost:1667")
    assert done.returncode == 2
    assert "pip install 'btcore[monitor]'" in done.stderr
    assert without_extras("--help").returncode == 0


@pytest.mark.parametrize(
    ("option", "value"),
    [("--seed", "-5"), ("--rate", "nan"), ("--rate", "inf"), ("--duration", "nan"), ("--duration", "-1")],
)
def test_a_number_that_makes_no_sense(cli: Cli, tree_file: TreeFile, option: str, value: str) -> None:
    refused(cli("run", tree_file("<AlwaysSuccess/>"), option, value), f"'{option}'")
