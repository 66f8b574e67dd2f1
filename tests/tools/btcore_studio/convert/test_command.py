"""`btcore convert`: format 4 on stdout or in a file, and the list of changes on stderr."""

from pathlib import Path

import pytest

from tests.btcore.cli.conftest import Cli

OLD = """<root main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <SequenceStar name="all"> <!-- in order -->
      <Action ID="Move" goal="${home}"/>
      <AlwaysSuccess/>
    </SequenceStar>
  </BehaviorTree>
</root>
"""
NEW = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <SequenceWithMemory name="all"> <!-- in order -->
      <Action ID="Move" goal="{home}"/>
      <AlwaysSuccess/>
    </SequenceWithMemory>
  </BehaviorTree>
</root>
"""


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "old.xml"
    path.write_bytes(OLD.encode())
    return path


def test_result_goes_to_stdout_and_the_changes_to_stderr(cli: Cli, old: Path) -> None:
    result = cli("convert", old.name)
    assert result.exit_code == 0
    assert result.stdout == NEW
    assert old.read_text() == OLD
    assert "old.xml:3:5: C202 <SequenceWithMemory> returns RUNNING" in result.stderr
    assert "✔ 3 rewritten with the same meaning, 1 with a new meaning" in result.stderr


def test_result_goes_into_another_file_or_replaces_the_old_file(cli: Cli, old: Path) -> None:
    assert cli("convert", old.name, "-o", "new.xml").stdout == ""
    assert (old.parent / "new.xml").read_text() == NEW
    cli("convert", old.name, "--in-place")
    assert old.read_text() == NEW
    again = cli("convert", old.name, "--in-place")
    assert (again.exit_code, old.read_text()) == (0, NEW)
    assert "the file already has format 4" in again.stderr


def test_byte_order_mark_and_line_ends_are_kept(cli: Cli, old: Path) -> None:
    old.write_bytes(b"\xef\xbb\xbf" + OLD.replace("\n", "\r\n").encode())
    cli("convert", old.name, "--in-place")
    assert old.read_bytes() == b"\xef\xbb\xbf" + NEW.replace("\n", "\r\n").encode()


GROOT_1 = '<Parallel threshold="1"><AlwaysSuccess/></Parallel>'


@pytest.mark.parametrize(
    ("body", "error"),
    [
        ("<ReactiveSequence/>", "E104 <ReactiveSequence> has no child"),
        (GROOT_1, "E201 <Parallel> has no port 'threshold'"),  # in both formats
        ("<OpenGripper/>", "E101 unknown node <OpenGripper>"),
    ],
)
def test_success_is_only_reported_for_file_that_is_valid(cli: Cli, old: Path, body: str, error: str) -> None:
    text = f'<root><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    old.write_text(text)
    result = cli("convert", old.name)
    assert result.exit_code == 2
    assert result.stdout.startswith('<root BTCPP_format="4">')
    assert error in result.stderr
    assert ", the result has 1 error" in result.stderr
    assert "✔" not in result.stderr
    # The source is only overwritten on request.
    result = cli("convert", old.name, "--in-place")
    assert (result.exit_code, old.read_text()) == (2, text)
    assert "note: old.xml is not changed; --force overwrites it nevertheless" in result.stderr
    assert cli("convert", old.name, "-o", "new.xml").exit_code == 2
    assert (old.parent / "new.xml").read_text().startswith('<root BTCPP_format="4">')
    assert cli("validate", "new.xml").exit_code == 2
    assert cli("convert", old.name, "--in-place", "--force").exit_code == 2
    assert old.read_text().startswith('<root BTCPP_format="4">')
    again = cli("convert", old.name)
    assert again.exit_code == 2
    assert error in again.stderr


def test_the_source_is_not_overwritten_by_another_name(cli: Cli, old: Path) -> None:
    result = cli("convert", old.name, "-o", f"../{old.parent.name}/{old.name}")
    assert (result.exit_code, old.read_text()) == (2, OLD)
    assert "is the file to convert: --in-place overwrites it if the result is valid" in result.stderr
    assert cli("convert", old.name, "-o", old.name, "--force").exit_code == 0
    assert old.read_text() == NEW


def test_model_defines_which_ports_are_outputs(cli: Cli, old: Path) -> None:
    model = old.parent / "model.xml"
    model.write_text(
        '<root><TreeNodesModel><Action ID="Find"><output_port name="place"/></Action></TreeNodesModel></root>'
    )
    old.write_text('<root><BehaviorTree ID="Main"><Find place="here"/></BehaviorTree></root>')
    assert '<Find place="{here}"/>' in cli("convert", old.name, "--model", model).stdout
    assert '<Find place="here"/>' in cli("convert", old.name).stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("old.xml", "--in-place", "-o", "x.xml"), "--in-place and --output cannot be used together"),
        (("odl.xml",), "; did you mean 'old.xml'?"),
        (("old.xml", "-o", "no/such/folder.xml"), "cannot write 'no/such/folder.xml'"),
        (("old.xml", "--model", "none.xml"), "no such file"),
    ],
)
def test_usage_errors_show_no_traceback(
    cli: Cli, old: Path, arguments: tuple[str, ...], message: str
) -> None:
    result = cli("convert", *arguments)
    assert result.exit_code == 2
    assert message in " ".join(result.stderr.split())
    assert "Traceback" not in result.stderr
