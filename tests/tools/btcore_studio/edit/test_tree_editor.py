"""Random operations on the trees of the repository, compared with the same operation on the parsed elements.

Comments and everything else stay as they were, and the inverse restores each byte, also after another edit
elsewhere.
"""

import gzip
import json
import os
import random
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from btcore.errors import TreeError
from btcore.registry.registry import Registry
from btcore.xml.edit.editor import Edit, EditError, apply_edits
from btcore.xml.read.element import Element
from btcore.xml.read.read import parse_text
from btcore.xml.read.scan import ScannedElement, scan
from btcore_studio.edit.text_edits import rebase_edits
from btcore_studio.edit.tree_editor import TreeEditor
from tests.tools.btcore_studio.edit.inverse_edits import invert_edits

ROOT = Path(__file__).parents[4]
FOLDERS = ("trees", "tests/robot_nodes", "tests/monitor/captures", "ros2")
RECORDED = ("v3_full", "v3_mutated", "v4_control", "v4_full", "v4_mutated", "v4_scopes")
COUNT = 500
"""The number of random operations with each seed."""
SEEDS = range(max(1, int(os.environ.get("BTCORE_EDITS", COUNT)) // COUNT))

MAIN = '<root BTCPP_format="4"><BehaviorTree ID="A">{}</BehaviorTree></root>'
Plain = tuple[str, dict[str, str], list["Plain"]]
"""The tag, the attributes and the children of an element."""


def repository_texts() -> dict[str, list[str]]:
    """Return the trees of the repository, and recorded documents of BehaviorTree.CPP, by file."""
    files = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.xml"))]
    found = {path.name: [path.read_bytes().decode()] for path in files}
    for name in RECORDED:
        with gzip.open(ROOT / f"tests/conformance/data/{name}.jsonl.gz", "rt", encoding="utf-8") as lines:
            cases = [json.loads(line) for line in lines]
        found[name] = [case["xml"] for case in cases if case.get("xml")]
    return found


@pytest.fixture(scope="module")
def texts() -> dict[str, list[str]]:
    return repository_texts()


def plain(element: Element) -> Plain:
    return element.tag, dict(element.attributes), [plain(child) for child in element.children]


def decorated(text: str, rng: random.Random) -> str:
    """Return a document with the same elements, but other line ends, indentation, comments and CDATA."""
    if rng.random() < 0.3:
        text = re.sub(r"^( +)", lambda match: "\t" * (len(match[1]) // 2), text, flags=re.MULTILINE)
    if rng.random() < 0.3:
        text = re.sub(r"^([ \t]+)(?=<[A-Za-z])", r"\1<!-- 🤖ä -->", text, flags=re.MULTILINE)
    if rng.random() < 0.3:
        text = re.sub(r"/>$", "/> <!-- <Sleep/> -->", text, flags=re.MULTILINE)
    if rng.random() < 0.3:
        text = text.replace("</BehaviorTree>", "<![CDATA[ <x> ]]></BehaviorTree>")
    if rng.random() < 0.3:
        text = re.sub(r"(?=<BehaviorTree)", '<include path="included.xml"/>', text, count=1)
    return text.replace("\n", "\r\n") if rng.random() < 0.3 else text


def find(whole: Plain, path: list[int]) -> Plain:
    for index in path:
        whole = whole[2][index]
    return whole


def path_of(element: ScannedElement) -> list[int]:
    path: list[int] = []
    while element.parent is not None:
        path.append(element.parent.children.index(element))
        element = element.parent
    return path[::-1]


class Operation:
    """A random operation on a document: its edits, and the same change of the parsed elements."""

    def __init__(self, text: str, model: Plain, rng: random.Random) -> None:
        self.editor = TreeEditor(scan(text))
        self.model = model
        self.rng = rng
        inside = [item for item in self.editor.scan.elements if "BehaviorTree" in map(str, tags_above(item))]
        self.element = rng.choice(inside)
        self.path = path_of(self.element)
        self.parent = find(model, self.path[:-1])
        self.index = self.path[-1]
        self.own = self.parent[2][self.index]

    def set_attribute(self) -> list[Edit]:
        name = self.rng.choice([*self.own[1], "name"])
        value = self.rng.choice(["a", "{b}", "<&\"'>", "1\n2", "🤖"])
        self.own[1][name] = value
        return [self.editor.set_attribute(self.element, name, value)]

    def rename_attribute(self) -> list[Edit]:
        name = self.rng.choice([*self.own[1], "none"])
        edit = self.editor.rename_attribute(self.element, name, "name")
        attributes = [("name" if key == name else key, value) for key, value in self.own[1].items()]
        self.own[1].clear()
        self.own[1].update(attributes)
        return [edit]

    def remove_attribute(self) -> list[Edit]:
        name = self.rng.choice([*self.own[1], "none"])
        self.own[1].pop(name, None)
        return [self.editor.remove_attribute(self.element, name)]

    def change_type(self) -> list[Edit]:
        id, ports = self.rng.choice((("Sleep", {"msec"}), ("Fallback", set()), ("Inverter", set())))
        edits = self.editor.change_type(self.element, id, ports)
        attributes = self.own[1]
        for name in [name for name in attributes if name[0] != "_" and name not in (*ports, "ID", "name")]:
            del attributes[name]
        if self.own[0] in ("Action", "Condition", "Control", "Decorator"):
            attributes["ID"] = id
        else:
            if self.own[0] in ("SubTree", "SubTreePlus"):
                attributes.pop("ID", None)
            self.parent[2][self.index] = (id, attributes, self.own[2])
        return edits

    def disable(self) -> list[Edit]:
        edit = self.editor.disable(self.element)
        condition = self.own[1].get("_skipIf")
        self.own[1]["_skipIf"] = f"true || ({condition})" if condition else "true"
        return [edit]

    def enable(self) -> list[Edit]:
        return [self.editor.enable(self.element)]

    def insert(self) -> list[Edit]:
        xml = self.rng.choice(
            ["<AlwaysSuccess/>", "<A/>\n<B>\n    <C/>\n</B>", "<A>", "text", '<Script code="a:=1;\n  b:=2"/>']
        )
        at = self.rng.randint(0, len(self.own[2]))
        edit = self.editor.insert(self.element, at, xml)
        self.own[2][at:at] = plain(parse_text(f"<root>{xml}</root>").root)[2]
        return [edit]

    def remove(self) -> list[Edit]:
        del self.parent[2][self.index]
        return [self.editor.remove(self.element)]

    def wrap(self) -> list[Edit]:
        last = self.rng.randint(self.index, len(self.parent[2]) - 1)
        children = self.parent[2][self.index : last + 1]
        self.parent[2][self.index : last + 1] = [("Fallback", {}, children)]
        assert self.element.parent is not None
        return self.editor.wrap(self.element.parent.children[self.index : last + 1], "Fallback")

    def unwrap(self) -> list[Edit]:
        edits = self.editor.unwrap(self.element)
        self.parent[2][self.index : self.index + 1] = self.own[2]
        return edits


def tags_above(element: ScannedElement) -> list[str]:
    return [around.tag for around in element.ancestors()]


OPERATIONS: list[Callable[[Operation], list[Edit]]] = [
    value for name, value in vars(Operation).items() if name[0] != "_"
]


def comments(text: str) -> list[str]:
    found = scan(text)
    return [found.text[start:end] for start, end in found.comments]


@pytest.mark.parametrize("seed", SEEDS)
def test_random_operations(texts: dict[str, list[str]], seed: int) -> None:
    rng = random.Random(f"edits:{seed}")
    outcomes = {"done": 0, "refused": 0}
    for number in range(COUNT):
        name = rng.choice(list(texts))
        text = decorated(rng.choice(texts[name]), rng)
        try:
            drawn = Operation(text, plain(parse_text(text).root), rng)
        except (TreeError, IndexError):
            continue  # a recorded document that is invalid, or has no nodes
        operation = rng.choice(OPERATIONS)
        place = f"{number}: {operation.__name__} in {name}"
        try:
            edits = operation(drawn)
            # The edits are right also if the result is no valid tree.
            result = apply_edits(text, edits)
            if drawn.model[2] and operation.__name__ != "enable":
                assert plain(parse_text(result).root) == drawn.model, place
            assert apply_edits(result, invert_edits(text, edits)) == text, place
            check_rest(drawn, text, result, operation.__name__, place)
            check_rebased(text, edits, rng, place)
        except EditError as error:
            outcomes["refused"] += bool(str(error))
        else:
            outcomes["done"] += 1
    assert min(outcomes.values()) > COUNT / 8, outcomes


def check_rest(drawn: Operation, text: str, result: str, name: str, place: str) -> None:
    """Comments remain, except those in a removed element, and the line ends are those of the document."""
    element = drawn.element
    own = comments(text[element.start : element.end]) if name == "remove" else []
    assert len(comments(result)) == len(comments(text)) - len(own), place
    if name not in ("set_attribute", "insert"):
        assert ("\r\n" in text) == ("\r\n" in result), place
        assert result.count("\n") == result.count("\r\n") or "\r\n" not in text, place


def check_rebased(text: str, edits: list[Edit], rng: random.Random, place: str) -> None:
    """The inverse restores the text after another edit, too, with that edit applied."""
    at = rng.choice([match.start() for match in re.finditer("<", text)])
    other = [Edit(at, at, "<!-- meanwhile -->")]
    try:
        after = rebase_edits(other, edits)
    except EditError:
        return
    result = apply_edits(text, edits)
    inverse = rebase_edits(invert_edits(text, edits), after)
    assert apply_edits(apply_edits(result, after), inverse) == apply_edits(text, other), place


def test_disabling_twice_and_enabling() -> None:
    text = MAIN.format('<AlwaysSuccess _skipIf="a &gt; 1"/>')
    disabled = text.replace("a &gt; 1", "true || (a > 1)")
    editor = TreeEditor(scan(text))
    assert apply_edits(text, [editor.disable(editor.scan.elements[-1])]) == disabled
    editor = TreeEditor(scan(disabled))
    with pytest.raises(EditError, match="disabled already"):
        editor.disable(editor.scan.elements[-1])
    assert apply_edits(disabled, [editor.enable(editor.scan.elements[-1])]) == text.replace("&gt;", ">")
    with pytest.raises(EditError, match="not disabled"):
        TreeEditor(scan(text)).enable(scan(text).elements[-1])


def test_ports_of_the_new_type_are_kept() -> None:
    text = MAIN.format('<Delay delay_msec="1" name="a" x="1"/>')
    editor = TreeEditor(scan(text))
    edits = editor.change_type(
        editor.scan.elements[-1], "Delay", Registry.standard().manifests["Delay"].ports
    )
    assert apply_edits(text, edits) == text.replace(' x="1"', "")
