"""Names with control characters are escaped in everything that the commands print."""

import io
import sys
from pathlib import Path

import pytest
from rich.live import Live
from rich.text import Text

from btcore.cli import terminal
from btcore.escaping import escape_controls
from tests.btcore.cli.conftest import Cli

TREE = """
<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence name="&#x9b;31m&#x202e;evil">
      <Script name="[/x]" code="key := 'a&#x202e;b'"/>
      <AlwaysSuccess name="&#x2066;leaf"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
WRONG = '<root BTCPP_format="4"><BehaviorTree ID="A"><Foo name="\u202e" x="\x9b2J"/></BehaviorTree></root>'
TITLE = "\x1b]0;title\x07"


@pytest.fixture
def hostile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tree.xml").write_text(TREE, encoding="utf-8")
    return tmp_path


def assert_escaped(text: str) -> None:
    assert escape_controls(text) == text


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (["show", "--ports"], r"code=key := 'a\u202eb'"),
        (["show", "--json"], r'"name": "\u009b31m\u202eevil"'),
        (["show", "--data"], "[/x] code"),
        (["run", "--fast", "--json"], r'"\u009b31m\u202eevil": {"id": "Sequence"'),
        (["run", "--fast", "--log", "-"], r"\u2066leaf                IDLE -> SUCCESS"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_names_in_trees_are_escaped(cli: Cli, hostile: Path, arguments: list[str], name: str) -> None:
    command, *options = arguments
    result = cli(command, "tree.xml", *options)
    assert_escaped(result.stdout)
    assert_escaped(result.stderr)
    assert name in result.stdout + result.stderr


def test_diagnostics_are_escaped(cli: Cli, hostile: Path) -> None:
    (hostile / "tree.xml").write_text(WRONG, encoding="utf-8")
    result = cli("validate", "tree.xml")
    assert result.exit_code == 2
    assert_escaped(result.stdout)
    assert r'<Foo name="\u202e" x="\x9b2J"/>' in result.stdout
    assert_escaped(cli("validate", "tree.xml", "--json").stdout)


def test_messages_tables_and_progress_are_escaped(capsys: pytest.CaptureFixture[str]) -> None:
    for print_message in (terminal.print_error, terminal.print_warning):
        print_message(f"{TITLE}\u202e")
    terminal.print_notes([TITLE])
    terminal.print_labelled(TITLE, TITLE)
    table = terminal.new_table()
    table.add_column("name")
    table.add_column("next")
    table.add_row(Text(f"{TITLE}\x9b", style="red"), "[/x]\u202e")
    console = terminal.stdout_console()
    console.print(table)
    with Live(console=console, auto_refresh=False) as live:
        live.update(Text(TITLE), refresh=True)
    output = capsys.readouterr()
    assert_escaped(output.out)
    assert_escaped(output.err)
    assert output.err.count(r"\x1b]0;title") == 5
    assert r"\x1b]0;title\x9b   [/x]\u202e" in output.out


def test_styles_stay_at_their_characters() -> None:
    text = Text.assemble("a\x9b", ("b\u202e", "red"), "c")
    escaped = terminal._escape(text)
    [span] = escaped.spans
    assert escaped.plain[span.start : span.end] == r"b\u202e"


def test_an_xml_document_is_escaped_at_a_terminal_only(monkeypatch: pytest.MonkeyPatch) -> None:
    class Screen(io.TextIOWrapper):
        def isatty(self) -> bool:
            return True

    # The encoding and the line ends of Windows: they concern a terminal, not a pipe or a file.
    for kind, expected in (
        (Screen, b'<a b="&#x9b;\xb7"/>\r\n'),
        (io.TextIOWrapper, '<a b="\x9b·"/>\n'.encode()),
    ):
        written = io.BytesIO()
        monkeypatch.setattr(sys, "stdout", kind(written, encoding="cp1252", newline="\r\n"))
        terminal.print_xml('<a b="\x9b·"/>\n')
        assert written.getvalue() == expected
