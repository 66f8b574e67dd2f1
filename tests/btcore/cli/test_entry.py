"""The process of a command: imports, installed packages, Ctrl-C, full disks, terminals limited to ASCII."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from btcore import entry_points
from btcore.cli.main import OWN_COMMANDS, SHORT_HELP, main
from tests.btcore.cli.conftest import Cli


@pytest.mark.parametrize("module", ["click.core", "btcore.errors", "rich.console", "btcore.tree.tree"])
def test_ctrl_c_while_a_module_is_imported_prints_no_traceback(module: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-X", "importtime", "-m", "btcore", "run", "bumpgo", "--fast", "--duration", "9"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        pipesize=4096,  # so that the process cannot be far ahead of the line that is read
        # These tests may run under nohup, and a child process inherits ignored signals.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        assert process.stderr is not None
        # With -X importtime, a line follows each import.
        assert any(line.split("|")[-1].strip() == module for line in process.stderr)
        process.send_signal(signal.SIGINT)
        # libmpdec prints a warning when the import of decimal was interrupted and is repeated.
        noise = ("import time:", "Modules/_decimal/libmpdec/")
        printed = [line for line in process.stderr if not any(text in line for text in noise)]
    assert process.returncode == 130
    assert "".join(printed).strip() == "interrupted"


ADDED_COMMANDS = sorted(point.name for point in entry_points.find(entry_points.COMMANDS_GROUP))


@pytest.mark.parametrize(
    "command",
    [
        ["--help"],
        ["show", "tree.xml"],
        ["show", "tree.xml", "--data"],
        ["validate", "tree.xml"],
        ["nodes"],
        ["run", "tree.xml", "--fast", "--log", "b.db3", "--log", "-"],
        ["stats", "a.db3"],
        ["diff", "a.db3", "a.db3"],
        ["replay", "a.db3", "--text"],
        *([name, "--help"] for name in (*OWN_COMMANDS, *ADDED_COMMANDS)),
    ],
    ids=" ".join,
)
@pytest.mark.usefixtures("folder")
def test_command_prints_on_a_terminal_that_is_limited_to_ascii(command: list[str]) -> None:
    if command[0] == "book":
        pytest.importorskip("cv2")
    result = CliRunner(charset="ascii").invoke(main, command, prog_name="btcore")
    assert result.exit_code == 0, result.output
    assert result.output_bytes.isascii()


IMPORTS = """
import atexit, sys
from btcore.__main__ import main

@atexit.register
def list_packages():
    packages = {name.partition(".")[0] for name in sys.modules}
    print("imported", *sorted(name for name in packages if name.startswith("btcore_")), file=sys.stderr)

main()
"""


def imported_by(*arguments: str, code: int = 0, **environment: str) -> set[str]:
    """Return the packages besides btcore that a command imports, and check its exit code."""
    command = [sys.executable, "-c", IMPORTS, *arguments]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, **environment}
    )
    assert done.returncode == code, done.stderr
    return set(done.stderr.splitlines()[-1].split()[1:])


PLUGIN = """
import gc
from random import Random
from btcore import In, action

print("the plugin is imported")

@action
def greet(who: In[str], random: Random) -> bool:
    return gc.isenabled() and gc.get_freeze_count() > 10_000  # what was imported is frozen
"""


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "command",
    [
        [],
        ["--help"],
        ["--version"],
        ["validate", "--help"],
        ["validate", "tree.xml"],
        ["show", "tree.xml"],
        ["run", "tree.xml", "--fast"],
        ["run", "tree.xml", "--fast", "--set", "x=3", "--log", "b.btlog", "--json"],
        ["run", "greeting.xml", "--plugin", "greeting.py"],
    ],
    ids=" ".join,
)
def test_command_without_a_robot_imports_btcore_and_its_own_package_alone(command: list[str]) -> None:
    Path("greeting.py").write_text(PLUGIN)
    Path("greeting.xml").write_text(
        '<root BTCPP_format="4" main_tree_to_execute="A"><BehaviorTree ID="A">'
        '<SubTree ID="B"/></BehaviorTree><BehaviorTree ID="B"><Greet who="Ada"/></BehaviorTree></root>'
    )
    own = {"btcore_drawing"} if "show" in command else set()
    assert imported_by(*command) - {"btcore_plugin_greeting"} == own


@pytest.mark.usefixtures("folder")
def test_log_format_imports_its_package_alone() -> None:
    assert imported_by("run", "tree.xml", "--fast", "--log", "b.db3") == {"btcore_monitor"}


BEFORE_THE_FIRST_TICK = """
import sys
from btcore.runs.tick_loop import TickLoop

def count(*_):
    names = {name for name in sys.modules if name.partition(".")[0] == "btcore"}
    print(len(names - {"btcore.__main__"}))
    sys.exit()

TickLoop.run = count
from btcore.__main__ import main
main()
"""


@pytest.mark.usefixtures("folder")
def test_a_run_without_a_robot_imports_at_most_110_modules_before_its_first_tick() -> None:
    command = [sys.executable, "-c", BEFORE_THE_FIRST_TICK, "run", "tree.xml", "--fast"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert 80 < int(done.stdout) <= 110


def test_command_is_suggested_and_completed_without_imports_of_other_packages() -> None:
    assert imported_by("wrold", code=2) == set()
    command = [sys.executable, "-c", IMPORTS.replace("main()\n", "sys.argv[0] = 'btcore'\nmain()\n")]
    words = {"_BTCORE_COMPLETE": "bash_complete", "COMP_WORDS": "btcore ", "COMP_CWORD": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ, **words})
    assert {f"plain,{name}" for name in (*OWN_COMMANDS, *ADDED_COMMANDS)} <= set(done.stdout.split())
    assert done.stderr == "imported\n"


def test_help_lists_every_command_of_btcore_and_no_other() -> None:
    installed = entry_points.find(entry_points.COMMANDS_GROUP)
    own = [point.name for point in installed if point.distribution == entry_points.OWN_DISTRIBUTION]
    assert list(SHORT_HELP) == [*OWN_COMMANDS, *own]
    listed = main.get_help(click.Context(main, max_content_width=200, terminal_width=200))
    for name, text in SHORT_HELP.items():
        assert f"  {name:<10}{text}\n" in f"{listed}\n"


@pytest.mark.parametrize(
    ("source", "help"),
    [
        ("@click.command(short_help='Greet a robot.')\ndef greet(): ...\n", "Greet a robot."),
        ("@click.command()\n@click.option('-x')\ndef greet(x):\n    'Greet. Twice.'\n", "Greet."),
        ("def greet(:\n", ""),
        (None, ""),
    ],
)
def test_help_lists_the_commands_of_other_distributions(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str | None, help: str
) -> None:
    information = tmp_path / "greeter-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: greeter\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[btcore.commands]\ngreet = greeter:greet\n")
    if source is not None:
        (tmp_path / "greeter.py").write_text(f"import click\n{source}")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "greeter", raising=False)
    assert f"  greet     {help}".rstrip() in cli("--help").output.splitlines()


@pytest.mark.usefixtures("folder")
def test_installed_nodes_are_loaded_if_the_tree_or_a_plugin_uses_them(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    checks = '<AreErrorCodesPresent error_code="103" error_codes_to_check="103;106"/>'
    Path("checks.xml").write_text(
        f'<root BTCPP_format="4"><BehaviorTree ID="Checks">{checks}</BehaviorTree></root>'
    )
    Path("including.xml").write_text(
        '<root BTCPP_format="4" main_tree_to_execute="A"><include path="checks.xml"/><BehaviorTree ID="A">'
        '<Sequence><Greet who="Ada"/><SubTree ID="Checks"/></Sequence></BehaviorTree></root>'
    )
    Path("greeting.py").write_text(PLUGIN)
    found = imported_by("run", "including.xml", "--plugin", "greeting.py")
    assert {"btcore_navigation", "btcore_robot"} <= found
    # The plugin is imported once, also if its nodes are registered again.
    command = [sys.executable, "-m", "btcore", "run", "including.xml", "--plugin", "greeting.py"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.count("the plugin is imported") == 1
    # The plugin has no text form of its own for the type of the library.
    Path("driving.py").write_text(
        "from btcore import In, action\nfrom btcore_robot.robot import Pose2D\n\n"
        "@action\ndef greet(who: In[Pose2D]) -> bool:\n    return who.x == 1.0\n"
    )
    Path("pose.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="A"><Greet who="1;2;0"/></BehaviorTree></root>'
    )
    assert "btcore_navigation" in imported_by("run", "pose.xml", "--plugin", "driving.py")


@pytest.mark.usefixtures("folder")
def test_options_of_providers_are_known_although_providers_are_loaded_on_demand() -> None:
    pytest.importorskip("zmq")
    run = [sys.executable, "-m", "btcore", "run", "tree.xml", "--fast"]
    done = subprocess.run([*run, "--world", "house"], capture_output=True, text=True, check=True)
    assert "--world has no effect" in done.stderr
    done = subprocess.run([*run, "--wrld", "arena"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "--world" in done.stderr
    assert "--world" in subprocess.run([*run, "--help"], capture_output=True, text=True, check=True).stdout


@pytest.mark.usefixtures("folder")
def test_provider_of_another_distribution_takes_part_if_its_option_is_given(tmp_path: Path) -> None:
    information = tmp_path / "rover-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: rover\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[btcore.providers]\nrover = rover:rover\n")
    Path("rover.py").write_text(
        "from typing import Annotated\n"
        "from btcore import Report, Settings, option, provider\n\n"
        "class RoverSettings(Settings):\n"
        "    rover: Annotated[str, option('The address.')]\n\n"
        "@provider\n"
        "def rover(settings: RoverSettings, report: Report) -> None:\n"
        "    report.add('rover', {'address': settings.rover})\n"
    )
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "btcore", "run", "tree.xml", "--fast", "--json", "--rover", "10.0.0.7"]
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert json.loads(done.stdout.splitlines()[-1])["rover"] == {"address": "10.0.0.7"}


@pytest.mark.usefixtures("folder")
def test_option_of_plugin_that_exists_already_is_error_and_one_without_device_has_no_effect() -> None:
    pytest.importorskip("zmq")
    text = (
        "from typing import Annotated\n"
        "from btcore import Settings, action, option, provider\n\n"
        "class Printer: ...\n\n"
        "@action\n"
        "def print_label(printer: Printer) -> bool:\n"
        "    return True\n\n"
        "class PrinterSettings(Settings):\n"
        "    device: Annotated[str, option('The device.')]\n"
        "    speed: Annotated[int, option('Labels per minute.')] = 20\n\n"
        "@provider\n"
        "def printer(settings: PrinterSettings) -> Printer:\n"
        "    return Printer()\n"
    )
    Path("printers.py").write_text(text)
    run = ["run", "tree.xml", "--fast", "--plugin", "printers.py"]
    result = CliRunner().invoke(main, [*run, "--speed", "30"], prog_name="btcore")
    assert result.exit_code == 0
    assert "--speed: no effect without --device" in result.stderr
    Path("printers.py").write_text(text.replace("device", "port"))
    result = CliRunner().invoke(main, run, prog_name="btcore")
    assert result.exit_code == 2
    assert "--port is an option of publisher" in result.stderr


@pytest.mark.usefixtures("folder")
def test_json_on_a_terminal_that_is_limited_to_ascii_keeps_every_character() -> None:
    result = CliRunner(charset="ascii").invoke(main, ["show", "tree.xml", "--json"], prog_name="btcore")
    assert json.loads(result.output_bytes)["name"] == "Küche → 😀"


@pytest.mark.usefixtures("folder")
def test_characters_beyond_ascii_are_replaced_by_similar_characters_or_escapes() -> None:
    result = CliRunner(charset="ascii").invoke(main, ["show", "tree.xml"], prog_name="btcore")
    assert r"`-- K\u00fcche > \ud83d\ude00  Sequence  1" in result.output


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Change to a folder with the tree tree.xml, whose names are not ASCII, and the log a.db3."""
    monkeypatch.chdir(tmp_path)
    tree = '<Sequence name="Küche → 😀"><Sleep name="Schläfchen" msec="9"/></Sequence>'
    Path("tree.xml").write_text(
        f'<root BTCPP_format="4"><BehaviorTree ID="Main">{tree}</BehaviorTree></root>', encoding="utf-8"
    )
    CliRunner().invoke(main, ["run", "tree.xml", "--fast", "--log", "a.db3"])


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_output_on_a_full_disk_is_an_error_with_the_exit_code_4() -> None:
    command = [sys.executable, "-m", "btcore", "show", "bumpgo"]
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (4, "error: cannot write the output: No space left on device\n")
