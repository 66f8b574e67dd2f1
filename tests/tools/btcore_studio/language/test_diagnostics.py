"""Every code that `btcore validate` reports is shown at the same place, counted in UTF-16 code units."""

import json
import re
from pathlib import Path

import pytest

pytest.importorskip("pygls")

from btcore import Registry
from btcore.diagnostics import Diagnostic
from btcore.errors import TreeError
from btcore.lint.validate import validate_document
from btcore.xml.read.read import parse_file
from btcore_studio.language.diagnostics import Report, check, merge, report_from_data
from btcore_studio.language.worker import Libraries

ROOT = Path(__file__).parents[4]
PAGE = (ROOT / "docs/reference/errors.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```xml ([EW][0-9]{3})\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
WIDE = "<!-- 🤖 -->"


def widened(text: str) -> str:
    """Return a document with a comment before each tag that begins inside of a line."""
    if text.strip() and not re.match(r"<(root|!DOCTYPE|BehaviorTree)", text):
        text = (
            '<root BTCPP_format="4" main_tree_to_execute="Main">'
            f'<BehaviorTree ID="Main">{text}</BehaviorTree></root>'
        )
    return re.sub(r"(?<=>)<(?=[A-Za-z])", f"{WIDE}<", text)


def expected(path: Path, nodes: Registry) -> list[Diagnostic]:
    try:
        return validate_document(parse_file(path), nodes=nodes)
    except TreeError as error:
        return list(error.diagnostics)


@pytest.mark.parametrize(("code", "text"), EXAMPLES, ids=[code for code, _ in EXAMPLES])
def test_every_code_of_validate(tmp_path: Path, code: str, text: str) -> None:
    path, nodes = tmp_path / "größe.xml", Registry.standard()
    text = widened(text)
    path.write_text(text, encoding="utf-8")
    diagnostics = expected(path, nodes)
    path.write_text("<root/>", encoding="utf-8")  # the text of the editor is not saved
    reports = check(lambda: parse_file(path, unsaved={path: text}), lambda _: nodes)
    assert code in [report.code for report in reports]
    lines = re.split(r"\r\n?|\n", text)
    for report, diagnostic in zip(reports, diagnostics, strict=True):
        for name in ("code", "message", "hint", "attributes", "characters"):
            assert getattr(report, name) == getattr(diagnostic, name)
        assert report_from_data(json.loads(json.dumps(report))) == report
        if diagnostic.column:
            line = lines[report.line].encode("utf-16-le")
            start = diagnostic.column - 1
            marked = diagnostic.source[start : start + diagnostic.width]
            assert line[2 * report.start : 2 * report.end].decode("utf-16-le") == marked
            assert len(line[: 2 * report.start].decode("utf-16-le")) == start


@pytest.mark.parametrize(
    ("name", "models", "codes"),
    [("größe.xml", [], []), ("größe.xml", ["größe.xml"], ["E201"]), ("haus.btproj", [], ["E201"])],
)
def test_models_of_a_tree_file_declare_unknown_nodes_and_override_none(
    tmp_path: Path, name: str, models: list[str], codes: list[str]
) -> None:
    path = tmp_path / name
    path.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Main">'
        '<Sequence><IsObstacle distance="1"/><Greet/></Sequence></BehaviorTree>'
        '<TreeNodesModel><Condition ID="IsObstacle"/><Action ID="Greet"/></TreeNodesModel></root>',
        encoding="utf-8",
    )
    libraries = Libraries([tmp_path], (), models, trusted=False)
    assert libraries.problems == []
    assert [report.code for report in check(lambda: parse_file(path), libraries.nodes_for)] == codes


def test_reports_of_several_checks_are_shown_once() -> None:
    def report(line: int, code: str, is_error: bool) -> Report:
        return Report("a.xml", line, 0, 1, code, is_error, "message", "", "")

    error, warning, other = report(9, "E101", True), report(1, "W104", False), report(0, "W201", False)
    assert merge([[error, warning], [error, other]]) == [error, other, warning]
