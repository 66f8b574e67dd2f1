"""docs/errors.md: every code of the source is explained there, and every example gives its code."""

import ast
import re
from pathlib import Path

import pytest

from btcore import Registry
from btcore.errors import TreeError
from btcore.xml.lint.validate import validate_document
from btcore.xml.read.document import parse_text

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "errors.md").read_text(encoding="utf-8")
CODE = re.compile(r"[EW][0-9]{3}")
HEADINGS = re.findall(r"^### ([EW][0-9]{3}) · ", PAGE, re.MULTILINE)
PARAGRAPHS = dict(
    re.findall(r"^### ([EW][0-9]{3}) · [^\n]+\n(.*?)(?=^##|\Z)", PAGE, re.MULTILINE | re.DOTALL)
)
EXAMPLES = re.findall(r"^```xml ([EW][0-9]{3})\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
# They need a file that can't be read, other bytes, a very large tree, a leaf's own code, or a batch.
WITHOUT_EXAMPLE = {"E003", "E004", "E006", "E115", "E117", "E118", "E120"}


def codes_of_the_source() -> set[str]:
    found = set()
    for path in sorted((ROOT / "btcore").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and CODE.fullmatch(node.value):
                found.add(node.value)
    return found


def test_every_code_is_explained_once_and_every_explained_code_exists() -> None:
    assert sorted(HEADINGS) == sorted(codes_of_the_source())


@pytest.mark.parametrize("code", HEADINGS)
def test_a_code_has_a_paragraph(code: str) -> None:
    prose = PARAGRAPHS[code].split("```")[0].strip()
    assert len(prose) > 30
    assert prose.endswith((".", ".)"))


def test_every_code_that_can_be_shown_has_an_example() -> None:
    assert [code for code, _ in EXAMPLES] == [code for code in HEADINGS if code not in WITHOUT_EXAMPLE]


@pytest.mark.parametrize(("code", "example"), EXAMPLES, ids=[code for code, _ in EXAMPLES])
def test_an_example_gives_its_code(code: str, example: str) -> None:
    text = example
    if example.strip() and not re.match(r"<(root|!DOCTYPE|BehaviorTree)", example):
        text = (
            '<root BTCPP_format="4" main_tree_to_execute="Main">'
            f'<BehaviorTree ID="Main">{example}</BehaviorTree></root>'
        )
    nodes = Registry.standard()
    try:
        found = [one.code for one in validate_document(parse_text(text), nodes=nodes)]
    except TreeError as tree_error:
        found = [one.code for one in tree_error.diagnostics]
    # A missing file is what W107 is told beside.
    assert set(found) == ({code, "E007"} if code == "W107" else {code})
