"""Names with control characters, which a robot sends, are escaped in everything that the commands print."""

import ast
from pathlib import Path

import pytest
from click.testing import CliRunner

import btcore_monitor
from btcore import SimClock, loads
from btcore.cli.main import main
from btcore.escaping import escape_controls
from btcore_monitor.breakpoints import BreakpointClient
from btcore_monitor.console import print_line
from btcore_monitor.serve import serve

TREE = """
<root BTCPP_format="4">
  <BehaviorTree ID="Main"><Sequence name="&#x9b;31m&#x202e;evil"><AlwaysSuccess/></Sequence></BehaviorTree>
</root>
"""


def test_a_line_stays_a_single_line_without_control_characters(capsys: pytest.CaptureFixture[str]) -> None:
    print_line("\x1b]0;title\x07\x9b\u202e\nreached Dock", err=True)
    assert capsys.readouterr().err == "\\x1b]0;title\\x07\\x9b\\u202e\\x0areached Dock\n"


@pytest.mark.parametrize("arguments", [["list"], ["clear"], ["break", "*", "--leave"]])
def test_names_in_a_robot_are_escaped_by_hook(no_threads_left: None, arguments: list[str]) -> None:
    tree = loads(TREE, clock=SimClock())
    with (
        serve(tree, groot2_port=0, allow_control=True) as publisher,
        BreakpointClient(publisher.address) as robot,
    ):
        robot.break_at("*")
        done = CliRunner().invoke(main, ["hook", publisher.address, *arguments])
    assert done.exit_code == 0
    assert r"\x9b31m\u202eevil" in done.stdout
    assert escape_controls(done.output) == done.output


def test_every_module_of_the_monitor_prints_by_the_function_that_escapes() -> None:
    folder = Path(btcore_monitor.__file__).parent
    calls = {
        f"{path.relative_to(folder)}:{call.lineno}"
        for path in folder.rglob("*.py")
        if path.name != "console.py"
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(call, ast.Call) and ast.unparse(call.func) in ("print", "click.echo", "click.secho")
    }
    assert calls == set()
