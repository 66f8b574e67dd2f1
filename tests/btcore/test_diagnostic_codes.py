"""docs/reference/errors.md describes every code of the table, and every example produces its code."""

import ast
import pickle
import re
import tomllib
from pathlib import Path

import pytest

from btcore import Registry, diagnostic_codes
from btcore.diagnostic_codes import ALL_CODES, DiagnosticCode
from btcore.errors import TreeError
from btcore.lint.validate import validate_document
from btcore.xml.read.read import parse_text
from btcore_studio.convert.convert import convert

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/reference/errors.md").read_text(encoding="utf-8")
CODE = re.compile(r"[EWC][0-9]{3}")
HEADINGS = re.findall(r"^### ([EWC][0-9]{3}) · ", PAGE, re.MULTILINE)
PARAGRAPHS = dict(
    re.findall(r"^### ([EWC][0-9]{3}) · [^\n]+\n(.*?)(?=^##|\Z)", PAGE, re.MULTILINE | re.DOTALL)
)
EXAMPLES = re.findall(r"^```xml ([EWC][0-9]{3})\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
# These require a file that cannot be read, other bytes, a very large document or tree, a leaf's own code or
# classes, or a batch.
WITHOUT_EXAMPLE = {"E003", "E004", "E006", "E010", "E115", "E117", "E118", "E120", "W214", "W215"}


def test_page_lists_exactly_the_codes_and_summaries_of_the_table() -> None:
    table = [(code, code.summary) for code in ALL_CODES]
    assert re.findall(r"^### ([EWC][0-9]{3}) · ([^\n]+)$", PAGE, re.MULTILINE) == table


def test_a_code_links_to_its_heading() -> None:
    headings = re.findall(r"^#+ (.+)$", PAGE, re.MULTILINE)
    anchors = {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}
    links = [code.url.split("#") for code in ALL_CODES]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    # The plugin "offline" of the documentation site gives pages the suffix .html; docs/site/build_site.py
    # compares the links with the built pages.
    assert {page for page, _ in links} == {project["urls"]["Documentation"] + "reference/errors.html"}
    assert {anchor for _, anchor in links} < anchors


def test_letter_and_digit_of_a_code_define_its_kind() -> None:
    kinds = {
        "E0": {"document error", "tree error"},
        "E1": {"tree error", "unknown node"},
        "E2": {"port error"},
        "W": {"warning"},
        "C1": {"same meaning"},
        "C2": {"new meaning"},
        "C3": {"manual step"},
    }
    for prefix, expected in kinds.items():
        assert {code.kind for code in ALL_CODES if code.startswith(prefix)} == expected
    severities = {"E": {"error"}, "W": {"warning"}, "C": {"change"}}
    for letter, severity in severities.items():
        assert {code.severity for code in ALL_CODES if code.startswith(letter)} == severity


def test_codes_are_unique_and_can_be_pickled() -> None:
    assert len(set(ALL_CODES)) == len(ALL_CODES)
    copied = pickle.loads(pickle.dumps(ALL_CODES[0]))
    assert (copied, copied.kind, copied.summary) == ("E001", ALL_CODES[0].kind, ALL_CODES[0].summary)


def test_every_code_is_used_and_comes_from_the_table() -> None:
    used, literals = set(), set()
    for path in (path for folder in ("btcore", "tools") for path in (ROOT / folder).rglob("*.py")):
        if path.stem != "diagnostic_codes":
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Name):
                    used.add(node.id)
                elif isinstance(node, ast.Constant) and CODE.fullmatch(str(node.value)):
                    literals.add(node.value)
    assert literals == set()
    names = {name for name, value in vars(diagnostic_codes).items() if isinstance(value, DiagnosticCode)}
    assert names - used == set()


@pytest.mark.parametrize("code", HEADINGS)
def test_every_code_has_a_paragraph(code: str) -> None:
    prose = PARAGRAPHS[code].split("```")[0].strip()
    assert len(prose) > 30
    assert prose.endswith((".", ".)"))


def test_every_code_that_can_be_shown_has_an_example() -> None:
    assert [code for code, _ in EXAMPLES] == [code for code in HEADINGS if code not in WITHOUT_EXAMPLE]


@pytest.mark.parametrize(("code", "example"), EXAMPLES, ids=[code for code, _ in EXAMPLES])
def test_example_produces_its_code(code: str, example: str) -> None:
    text = example
    if example.strip() and not re.match(r"<(root|!DOCTYPE|BehaviorTree)", example):
        text = (
            '<root BTCPP_format="4" main_tree_to_execute="Main">'
            f'<BehaviorTree ID="Main">{example}</BehaviorTree></root>'
        )
    nodes = Registry.standard()
    if code.startswith("C"):
        if not example.startswith("<root"):
            text = text.replace('BTCPP_format="4"', 'BTCPP_format="3"')
        changes = convert(parse_text(text), nodes).changes
        assert code in [change.code for change in changes]
        return
    try:
        found = [diagnostic.code for diagnostic in validate_document(parse_text(text), nodes=nodes)]
    except TreeError as tree_error:
        found = [diagnostic.code for diagnostic in tree_error.diagnostics]
    # W107 is reported together with a missing file.
    assert set(found) == ({code, "E007"} if code == "W107" else {code})
