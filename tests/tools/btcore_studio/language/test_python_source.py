# ruff: noqa: E501 - tables
"""The source of node libraries is read without running it."""

import inspect
from collections.abc import Iterable
from pathlib import Path

import pytest

pytest.importorskip("pygls")

from btcore import Registry
from btcore.lint.validate import validate_document
from btcore.xml.read.read import parse_text
from btcore_studio.language.node_models import NodeModel, add_stubs, models_of
from btcore_studio.language.python_source import module_file, read_nodes

ROOT = Path(__file__).parents[4]
LIBRARY = ROOT / "robot_nodes" / "btcore_robot" / "leaves"


def test_the_source_of_the_robot_library_agrees_with_its_registration() -> None:
    pytest.importorskip("numpy")
    nodes = Registry.standard()
    nodes.add_plugin("btcore_robot.leaves")
    registered = {model.id: model for model in models_of(nodes)}
    read = {model.id: model for file in sorted(LIBRARY.glob("*.py")) for model in models_in(file)}
    assert len(registered) > 10
    assert set(registered) <= set(read)
    for id, model in registered.items():
        found = read[id]
        assert (found.type, found.description, found.line) == (model.type, model.description, model.line), id
        assert [(port.name, port.direction, port.type, port.description) for port in found.ports] == [
            (port.name, port.direction, port.type, port.description) for port in model.ports
        ], id
        # The values of constants are unknown, but not that there is a default.
        assert [port.default is None for port in found.ports] == [
            port.default is None for port in model.ports
        ]


def models_in(file: Path) -> Iterable[NodeModel]:
    return read_nodes(file)[0]


def test_forms_of_leaves_and_ports(tmp_path: Path) -> None:
    (tmp_path / "shapes.py").write_text(
        "import btcore\nclass Shape(btcore.StatefulAction):\n    größe: btcore.In['float'] = 1.5\n",
        encoding="utf-8",
    )
    source = tmp_path / "leaves.py"
    source.write_text(
        inspect.cleandoc(
            '''
            from typing import Annotated
            import btcore as bt
            from btcore import In, Put
            from shapes import Shape
            raise SystemExit("never runs")

            @bt.action(ID="Wave")
            async def wave_hand(times: "In[int]" = 3, done: Put[bool] = None, robot: object = None) -> bool:
                """Wave 🤖."""

            @bt.condition
            def is_dark(level: Annotated[In[float | None], "in lux"]): ...

            def plain(words: In[list[str]]): ...

            class Square(Shape):
                color: bt.InOut[Color] = Color.RED

            class Listed(bt.SyncAction):
                @staticmethod
                def provided_ports():
                    return [bt.Port("a", bt.Direction.OUT), bt.Port("b", default="x", description="B")]

            class Twice(bt.DecoratorNode): ...
            class _Hidden(bt.SyncAction): ...
            class NoNode: ...

            def register(nodes):
                nodes.add(plain, ID="Plain")
            '''
        ),
        encoding="utf-8",
    )  # fmt: skip
    models, files = read_nodes(source, [tmp_path])
    assert files == {source, tmp_path / "shapes.py"}
    assert [
        (model.id, model.type, [(p.name, p.direction, p.type, p.default, p.description) for p in model.ports])
        for model in models
    ] == [
        ("Wave", "ACTION", [("times", "input", "int", "3", ""), ("done", "output", "bool", "", "")]),
        ("IsDark", "CONDITION", [("level", "input", "double", None, "in lux")]),
        ("Plain", "ACTION", [("words", "input", "std::vector<std::string>", None, "")]),
        ("Square", "ACTION", [("größe", "input", "double", "1.500000", ""), ("color", "inout", "Color", "RED", "")]),
        ("Listed", "ACTION", [("a", "output", "BT::AnyTypeAllowed", None, ""), ("b", "input", "BT::AnyTypeAllowed", "x", "B")]),
        ("Twice", "DECORATOR", []),
    ]  # fmt: skip
    assert (models[0].description, models[0].line) == ("Wave 🤖.", 7)
    # The models are the nodes of a registry.
    nodes = Registry.standard()
    add_stubs(nodes, [NodeModel.from_data(model.as_data()) for model in models], {})
    text = (
        '<root BTCPP_format="4"><BehaviorTree ID="A"><Twice><Wave times="x"/></Twice></BehaviorTree></root>'
    )
    assert [item.code for item in validate_document(parse_text(text), nodes=nodes)] == ["E202"]


@pytest.mark.parametrize("source", ["def", "x = " + "(" * 300 + ")" * 300, "\0", "a" + ".b" * 100_000])
def test_source_that_cannot_be_read(tmp_path: Path, source: str) -> None:
    path = tmp_path / "leaves.py"
    path.write_text(source, encoding="utf-8")
    with pytest.raises(SyntaxError):
        read_nodes(path)


def test_files_of_modules(tmp_path: Path) -> None:
    package = tmp_path / "robot" / "leaves"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "arm.py").touch()
    folders = [tmp_path / "missing", tmp_path]
    assert module_file("robot.leaves:register", folders) == package / "__init__.py"
    assert module_file("robot.leaves.arm", folders) == module_file("robot/leaves/arm.py", folders)
    assert module_file("robot.leaves.leg", folders) is None
