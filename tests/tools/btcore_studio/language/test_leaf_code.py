"""The request btcore/leaf: Python code of nodes that are known from a model, and tests of it that pass."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from btcore import Registry
from btcore.xml.edit.editor import EditError, escape_value
from btcore_studio.language.element_texts import port_text
from btcore_studio.language.leaf_code import leaf_of
from btcore_studio.language.project import Project
from btcore_studio.language.studio_protocol import Leaf, PalettePort

TYPES = (
    "",
    "std::string",
    "string",
    "int",
    "unsigned int",
    "long",
    "double",
    "float",
    "bool",
    "BT::NodeStatus",
)
VECTORS = ("std::vector<double>", "std::vector<std::string>", "std::vector<int>", "Pose2D")
NAMES = (
    "goal",
    "a-b",
    "class",
    "tick",
    "path",
    "In",
    "status",
    "children",
    "int",
    "Größe",
    "self_",
    "x",
    "loads",
)
IDS = (
    "Go",
    "GoTo2D",
    "action",
    "class",
    "Go-Home",
    "Größe",
    "In",
    "str",
    "Sensor(1)",
    "日本",
    "register",
    "_x",
    "1a",
)


def leaf(project: Project, node_type: str, id: str, ports: list[PalettePort]) -> Leaf:
    """Return the code for a model."""
    models = "".join(map(port_text, ports))
    text = (
        '<root BTCPP_format="4"><TreeNodesModel>'
        f'<{node_type} ID="{escape_value(id)}">{models}</{node_type}></TreeNodesModel></root>'
    )
    return leaf_of(project, project.open("untitled:tree.xml", text, 1), id)


def run_test(folder: Path, written: Leaf) -> None:
    """Write the files, compile the code, and run the test function in this process."""
    (folder / written.name).write_text(written.text, encoding="utf-8")
    (folder / written.test_name).write_text(written.test, encoding="utf-8")
    compile(written.text, written.name, "exec")
    module: dict[str, object] = {"__file__": str(folder / written.test_name)}
    exec(compile(written.test, written.test_name, "exec"), module)
    tests: list[Callable[[], None]] = [value for name, value in module.items() if name.startswith("test_")]  # type: ignore[misc]
    assert len(tests) == 1
    tests[0]()


def with_own_keys(ports: list[PalettePort]) -> list[PalettePort]:
    """Give each port another key, because an entry has one type."""
    return [
        msgspec.structs.replace(port, default=port.default.replace("{key}", f"{{key {number}}}"))
        for number, port in enumerate(ports)
    ]


ports = st.lists(
    st.builds(
        PalettePort,
        st.sampled_from(NAMES),
        st.sampled_from(("in", "out", "inout")),
        st.sampled_from(TYPES + VECTORS),
        st.sampled_from(("", "", "1", "0.5", "true", "inf", "{key}", "=", "it's \\ <\"", "1;2")),
        st.sampled_from(("", "", "where to", 'it\'s \\ "a" # [x] {y}')),
    ),
    max_size=4,
    unique_by=lambda port: port.name,
).map(with_own_keys)


@settings(
    max_examples=150,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    derandomize=True,
)
@given(
    node_type=st.sampled_from(("Action", "Condition", "Control", "Decorator")),
    id=st.sampled_from(IDS),
    ports=ports,
)
def test_the_written_test_passes(
    project: Project,
    tmp_path_factory: pytest.TempPathFactory,
    node_type: str,
    id: str,
    ports: list[PalettePort],
) -> None:
    written = leaf(project, node_type, id, ports)
    folder = tmp_path_factory.mktemp("leaf")
    run_test(folder, written)
    nodes = Registry.standard()
    nodes.add_plugin(folder / written.name)
    manifest = nodes.get(id)
    assert manifest is not None
    assert manifest.type.name == node_type.upper()
    directions = {"in": "IN", "out": "OUT", "inout": "INOUT"}
    assert {port.name: (directions[port.direction], port.about) for port in ports} == {
        port.name: (port.direction.name, port.description) for port in manifest.ports.values()
    }
    assert {port.name for port in ports if not port.default} == {
        port.name for port in manifest.ports.values() if port.default is None
    }


def test_a_function_and_a_class(project: Project) -> None:
    goal = PalettePort("goal", "in", "std::string", "", "where to")
    speed = PalettePort("speed", "in", "double", "0.5", "")
    left = PalettePort("left", "out", "double", "{left}", "")
    assert leaf(project, "Action", "GoTo", [speed, goal, left]).text == (
        '"""The node GoTo."""\n\n'
        "from typing import Annotated\n\n"
        "from btcore import SUCCESS, In, Put, Status, action\n\n\n"
        '@action(ID="GoTo")\n'
        "def go_to(\n"
        "    goal: Annotated[In[str], 'where to'],\n"
        "    speed: In[float] = 0.5,\n"
        "    left: Put[float] = '{left}',  # type: ignore[assignment]\n"
        ") -> Status:\n"
        '    """TODO: describe GoTo."""\n'
        "    return SUCCESS  # TODO: write the action\n"
    )
    text = leaf(project, "Decorator", "Twice", [speed]).text
    assert "class Twice(DecoratorNode):" in text
    assert "    speed: In[float] = 0.5\n" in text


def test_mypy_and_pytest_accept_the_code(project: Project, tmp_path: Path) -> None:
    written = []
    for node_type in ("Action", "Condition", "Control", "Decorator"):
        for direction in ("in", "inout"):
            listed = [
                PalettePort(f"p{number}", direction, name, default, "about")  # type: ignore[arg-type]
                for number, (name, default) in enumerate(
                    zip(TYPES, ("", "{k}", "", "1", "", "", "{k}", "", "", ""), strict=True)
                )
            ]
            listed.append(PalettePort("result", "out", "int", "", ""))
            written.append(leaf(project, node_type, f"{node_type}{direction.title()}", listed))
    written.append(leaf(project, "Action", "Awkward", [PalettePort("a-b", "in", "int", "1", "")]))
    for item in written:
        (tmp_path / item.name).write_text(item.text)
        (tmp_path / item.test_name).write_text(item.test)
    for command in (["pytest", "-q", "-p", "no:cacheprovider"], ["mypy", "--strict"]):
        arguments = [] if command[0] == "pytest" else [item.name for item in written]
        done = subprocess.run(
            [sys.executable, "-m", *command, *arguments],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr


def test_refusals(project: Project) -> None:
    source = project.open("untitled:tree.xml", '<root BTCPP_format="4"/>', 1)
    for id, reason in (
        ("Sleep", "has code already"),
        ("Go", "write its model first"),
        ("SubTree", "SubTree"),
    ):
        with pytest.raises(EditError, match=reason):
            leaf_of(project, source, id)
