"""Tests of the inlay hints and the semantic tokens."""

from pathlib import Path

import pytest
from lsprotocol import types

from btcore_studio.language.completion import complete
from btcore_studio.language.hover import hover
from btcore_studio.language.inlay_hints import inlay_hints
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.semantic_tokens import LEGEND, semantic_tokens
from tests.tools.btcore_studio.language.conftest import ROOT

TREES = """<root BTCPP_format="4" main_tree_to_execute="Ä">
<BehaviorTree ID="Ä"><Sequence>
<GetWaypoint waypoint="{ziel🤖}"/><SubTree ID="B" goal="{ziel🤖}" n="{=}"/></Sequence></BehaviorTree>
<BehaviorTree ID="B"><Sequence><Move name="Hin" goal="{goal}"/>
<Script code="n := RED; n += 0x1F; s := 'ä🤖' .. '&lt;'"/><Move goal="{n}" _skipIf="n == true"/>
</Sequence></BehaviorTree>
</root>"""
EVERYTHING = types.Range(types.Position(0, 0), types.Position(10_000, 0))


def hints_in(project: Project, document: SourceDocument, range: types.Range = EVERYTHING) -> list[str]:
    """Return the hints as the text before each hint, and its label."""
    shown = []
    for hint in inlay_hints(project, document, range):
        offset = document.positions.offset(hint.position)
        shown.append(f"{document.text[:offset].split()[-1]} {hint.label}")
    return shown


def tokens_in(document: SourceDocument, tokens: types.SemanticTokens) -> list[str]:
    """Return the tokens as `text type` with `!` after the type of a modification."""
    lines = [line.encode("utf-16-le") for line in document.text.split("\n")]
    line = character = 0
    shown = []
    for at in range(0, len(tokens.data), 5):
        down, right, length, kind, modifiers = tokens.data[at : at + 5]
        line += down
        character = right if down else character + right
        word = lines[line][2 * character : 2 * (character + length)].decode("utf-16-le")
        shown.append(f"{word} {LEGEND.token_types[kind]}{'!' * modifiers}")
    return shown


def test_hints_show_types_and_remapped_names(project: Project) -> None:
    document = project.open("untitled:a", TREES, 1)
    assert hints_in(project, document) == [
        'waypoint="{ziel🤖}" : Pose2D',
        'n="{=}" {n}: Pose2D',
        'goal="{goal}" : Pose2D = ziel🤖',
        'code="n : Pose2D',
    ]


def test_hints_of_a_range(project: Project) -> None:
    document = project.open("untitled:a", TREES, 1)
    fourth_line = types.Range(types.Position(3, 0), types.Position(4, 0))
    assert hints_in(project, document, fourth_line) == ['goal="{goal}" : Pose2D = ziel🤖']


def test_tokens_of_scripts_and_keys(project: Project) -> None:
    document = project.open("untitled:a", TREES, 1)
    assert tokens_in(document, semantic_tokens(project, document)) == [
        "ziel🤖 variable!", "goal property", "ziel🤖 variable", "n property", "{=} variable", "goal variable",
        "n variable!", ":= operator", "RED enumMember", "; operator",
        "n variable!", "+= operator", "0x1F number", "; operator",
        "s variable!", ":= operator", "'ä🤖' string", ".. operator", "'&lt;' string",
        "n variable", "n variable", "== operator", "true keyword",
    ]  # fmt: skip
    fourth_line = types.Range(types.Position(3, 0), types.Position(4, 0))
    assert tokens_in(document, semantic_tokens(project, document, fourth_line)) == ["goal variable"]


FILES = sorted((ROOT / "trees").rglob("*.xml"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_tokens_of_real_files_are_in_order(project: Project, path: Path) -> None:
    document = project.open("untitled:a", path.read_text(encoding="utf-8"), 1)
    shown = tokens_in(document, semantic_tokens(project, document))
    keys = document.text.count('"{')
    assert sum(token.endswith(("variable", "variable!")) for token in shown) >= keys
    assert all(token.split(" ")[0] for token in shown)


def test_features_accept_broken_text_at_every_place(project: Project) -> None:
    """Type a tree with every feature after each few characters."""
    for text in (TREES, (ROOT / "trees" / "patrolling_skipping.xml").read_text(encoding="utf-8")[:1500]):
        document = project.open("untitled:a", "", 1)
        for version, end in enumerate(range(1, len(text), 11)):
            start = document.positions.position(len(document.text))
            added = text[len(document.text) : end]
            change = types.TextDocumentContentChangePartial(types.Range(start, start), added)
            document = project.change("untitled:a", [change], version)
            assert document.text == text[:end]
            complete(project, document, end)
            hover(project, document, end - 1)
            inlay_hints(project, document, EVERYTHING)
            semantic_tokens(project, document)
