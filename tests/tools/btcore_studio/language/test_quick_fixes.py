# ruff: noqa: E501 - each case is a line
"""Quick fixes of diagnostics, and the conversion to format 4."""

from pathlib import Path

import pytest

pytest.importorskip("pygls")

from click.testing import CliRunner
from lsprotocol import types

from btcore.cli.main import main
from btcore.registry.registry import Registry
from btcore.xml.edit.editor import apply_edits
from btcore.xml.read.read import parse_file
from btcore_studio.language.diagnostics import Report, check
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.quick_fixes import code_actions, convert_to_4
from btcore_studio.language.worker import Libraries

MAIN = '<root BTCPP_format="4"><!-- 🤖 Grüße --><BehaviorTree ID="Main">{}</BehaviorTree></root>'


class EditedDocument:
    """A document in *path* whose text is checked and fixed."""

    def __init__(self, path: Path, text: str) -> None:
        self.project = Project()
        self.path = path
        self.write(text)

    def write(self, text: str) -> None:
        self.document = self.project.open(self.path.as_uri(), text, 1)

    def reports(self) -> list[Report]:
        nodes = Registry.standard()
        return check(
            lambda: parse_file(self.path, unsaved=self.project.unsaved),
            lambda _: nodes,
            text_of=lambda _: self.document.text,
        )

    def fixes(self, code: str) -> dict[str, str]:
        """The texts that the fixes of the first report with *code* produce, by title."""
        report = next(item for item in self.reports() if item.code == code)
        return {fix.title: apply_edits(self.document.text, fix.edits) for fix in report.fixes}

    def codes(self) -> list[str]:
        return [item.code for item in self.reports()]


def test_declaring_a_node_makes_the_file_valid(tmp_path: Path) -> None:
    path = tmp_path / "tree.xml"
    edited = EditedDocument(
        path, MAIN.format('<Sequence><Script code="g := 1"/><Greet who="{g}" times="2"/></Sequence>')
    )
    text = edited.fixes("E101")["Declare <Greet> in the <TreeNodesModel>"]
    assert '<inout_port name="who"/>' in text
    assert '<input_port name="times"/>' in text
    # The editor needs no code, and the command line the same as an option.
    path.write_text(text, encoding="utf-8")
    libraries = Libraries([tmp_path], (), (), trusted=False)
    assert check(lambda: parse_file(path), libraries.nodes_for) == []
    result = CliRunner().invoke(main, ["validate", str(path), "--model", str(path)])
    assert result.exit_code == 0, result.output


def test_the_conversion_to_format_4(tmp_path: Path) -> None:
    old = '<root main_tree_to_execute="A"><BehaviorTree ID="A"><SequenceStar><AlwaysSuccess/></SequenceStar></BehaviorTree></root>'
    edited = EditedDocument(tmp_path / "tree.xml", old)
    fix = convert_to_4(edited.project, edited.document)
    assert fix is not None
    (edit,) = fix.edits
    text = old[: edit.start] + edit.text + old[edit.end :]
    assert 'BTCPP_format="4"' in text
    assert "<SequenceWithMemory>" in text
    edited.write(text)
    assert edited.codes() == []
    assert convert_to_4(edited.project, edited.document) is None


def test_code_actions_are_those_of_the_range(tmp_path: Path) -> None:
    edited = EditedDocument(tmp_path / "tree.xml", MAIN.format("<Sequense><Slep/></Sequense>"))
    document = edited.document
    whole = document.positions.range(0, len(document.text))
    at = document.positions.position(document.text.index("Slep"))
    reports = edited.reports()
    edited.project.set_reports(document.key, 1, reports)

    def titles(range: types.Range, only: list[types.CodeActionKind] | None = None) -> list[str]:
        identifier = types.TextDocumentIdentifier(document.uri)
        params = types.CodeActionParams(identifier, range, types.CodeActionContext([], only))
        return [action.title for action in code_actions(edited.project, document, params)]

    assert titles(types.Range(at, at))[0] == "Change to <Sleep>"
    assert titles(whole)[0] == "Change to <Sequence>"
    assert titles(whole, [types.CodeActionKind.Refactor]) == []
    # A change that removes two diagnostics is offered once.
    edited.write(MAIN.format("<IfThenElse/>"))
    document = edited.document
    edited.project.set_reports(document.key, 1, edited.reports())
    assert edited.codes() == ["E104", "E119"]
    assert titles(document.positions.range(0, len(document.text))) == ["Add 2 children"]
    # Reports about an older text are not fixed.
    newer: SourceDocument = edited.project.open(document.uri, document.text, 2)
    params = types.CodeActionParams(
        types.TextDocumentIdentifier(document.uri), whole, types.CodeActionContext([])
    )
    assert code_actions(edited.project, newer, params) == []
