"""Values written as `json:…` in ports and on the blackboard."""

import json
from dataclasses import dataclass

import pytest

from btcore import In, NodeExecutionError, TreeError, action
from tests.btcore.conftest import TreeFactory


@dataclass
class Pose:
    x: float
    y: float


class Seen:
    def __init__(self) -> None:
        self.values: list[object] = []


@action
def numbers(given: In[list[int]], seen: Seen) -> bool:
    seen.values.append(given)
    return True


@action
def texts(given: In[list[str]], seen: Seen) -> bool:
    seen.values.append(given)
    return True


@action
def text(given: In[str], seen: Seen) -> bool:
    seen.values.append(given)
    return True


@action
def pose(given: In[Pose], seen: Seen) -> bool:
    seen.values.append(given)
    return True


LEAVES = (numbers, texts, text, pose)


def read(make_tree: TreeFactory, tag: str, written: str, format: int = 4) -> object:
    """Return the value that the leaf *tag* reads for *written*, in its port and from the blackboard."""
    seen = Seen()
    literal = make_tree(f"<{tag} given='{written}'/>", *LEAVES, resources=[seen], format=format)
    literal.tick_once()
    entry = make_tree(f'<{tag} given="{{k}}"/>', *LEAVES, resources=[seen], format=format)
    found = entry.blackboard.find("k")
    assert found is not None
    found.put(written, 0)
    entry.tick_once()
    assert seen.values[0] == seen.values[1]
    return seen.values[0]


@pytest.mark.parametrize(
    ("tag", "written", "value"),
    [
        ("Numbers", "1;2;3", [1, 2, 3]),
        ("Numbers", "json:[1,2,3]", [1, 2, 3]),
        ("Texts", 'json:["a;b", "c"]', ["a;b", "c"]),
        ("Texts", "a;b", ["a", "b"]),
        ("Pose", 'json:{"x": 1, "y": 2.5}', Pose(1, 2.5)),
        ("Pose", 'json:{"__type": "Pose", "x": 1, "y": 2.5}', Pose(1, 2.5)),
    ],
)
def test_list_or_record_may_be_json(tag: str, written: str, value: object, make_tree: TreeFactory) -> None:
    assert read(make_tree, tag, written) == value


def test_text_port_keeps_json_as_text(make_tree: TreeFactory) -> None:
    assert read(make_tree, "Text", 'json:{"x": 1}') == 'json:{"x": 1}'


def test_converter_and_json_are_both_accepted(make_tree: TreeFactory) -> None:
    seen = Seen()
    nodes = make_tree("<AlwaysSuccess/>").registry
    nodes.add_type(Pose, lambda message: Pose(*map(float, message.split(","))))
    body = "<Sequence><Pose given='1,2'/><Pose given='json:{\"x\": 1, \"y\": 2}'/></Sequence>"
    make_tree(body, pose, nodes=nodes, resources=[seen]).tick_once()
    assert seen.values == [Pose(1, 2), Pose(1, 2)]


@pytest.mark.parametrize(
    ("tag", "written"),
    [("Pose", "1;2"), ("Pose", "json:[1]"), ("Pose", 'json:{"z": 1}'), ("Numbers", 'json:{"x": 1}')],
)
def test_value_that_does_not_convert_is_refused_when_the_tree_is_built(
    tag: str, written: str, make_tree: TreeFactory
) -> None:
    with pytest.raises(TreeError, match="given"):
        make_tree(f"<{tag} given='{written}'/>", *LEAVES, resources=[Seen()])


def test_format_3_does_not_read_json(make_tree: TreeFactory) -> None:
    seen = Seen()
    tree = make_tree("<Numbers given='json:[7,8]'/>", *LEAVES, resources=[seen], format=3)
    tree.tick_once()
    assert seen.values != [[7, 8]]
    with pytest.raises((TreeError, NodeExecutionError), match="given"):
        make_tree(
            """<Pose given='json:{"x": 1, "y": 2}'/>""", *LEAVES, resources=[seen], format=3
        ).tick_once()


def test_value_is_written_as_json_and_read_back(make_tree: TreeFactory) -> None:
    tree = make_tree("<AlwaysSuccess/>")
    text = tree.registry.types.of(Pose).to_text(Pose(1.0, 2.5))
    assert text.startswith("json:")
    record = json.loads(text.removeprefix("json:"))
    assert (record["x"], record["y"]) == (1.0, 2.5)
    assert tree.registry.types.of(Pose).from_text(text) == Pose(1.0, 2.5)
