"""Write the Python code of a node that is known from a model alone, and its test."""

import ast
import builtins
import math
import re
from contextlib import suppress
from keyword import iskeyword
from typing import Final
from unicodedata import normalize

from btcore import values
from btcore.blackboard.ports import Direction, Port, remapped_key
from btcore.engine.control import ControlNode, DecoratorNode
from btcore.engine.leaf import Condition, SyncAction
from btcore.errors import BtcoreError
from btcore.names import port_name_error
from btcore.registry.manifest import Manifest, takes_children
from btcore.registry.nodes_without_code import is_mock
from btcore.status import NodeType
from btcore.values.types import BoolType, IntegerType, RealType
from btcore.xml.edit.editor import EditError
from btcore.xml.models.tree_nodes_model import TAG_OF
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.studio_protocol import Leaf
from btcore_studio.language.tree_reading import read_trees

_MAX_NAME: Final = 60
# The annotation of a port and a value for the test, by the name of the type in C++.
_TYPES: Final = {
    "std::string": ("str", '"text"'),
    "int": ("int", "1"),
    "long": ("Int64", "1"),
    "unsigned int": ("UInt32", "1"),
    "unsigned long": ("UInt64", "1"),
    "double": ("float", "1.0"),
    "float": ("Float32", "1.0"),
    "bool": ("bool", "True"),
    "BT::NodeStatus": ("Status", "SUCCESS"),
    "std::vector<int>": ("list[int]", "[1]"),
    "std::vector<double>": ("list[float]", "[1.0]"),
    "std::vector<bool>": ("list[bool]", "[True]"),
    "std::vector<std::string>": ("list[str]", '["text"]'),
}
_ANY: Final = ("object", '"text"')
_OF_VALUES: Final = ("Float32", "Int64", "UInt32", "UInt64")
_BASES: Final = {
    NodeType.ACTION: SyncAction,
    NodeType.CONDITION: Condition,
    NodeType.CONTROL: ControlNode,
    NodeType.DECORATOR: DecoratorNode,
}
_BODIES: Final = {
    NodeType.ACTION: ["return SUCCESS  # TODO: write the action"],
    NodeType.CONDITION: ["return SUCCESS  # TODO: write the condition"],
    NodeType.CONTROL: [
        "# TODO: decide which children are ticked",
        "self.set_status(RUNNING)",
        "for child in self.children:",
        "    status = child.execute_tick()",
        "    if status is RUNNING:",
        "        return status",
        "    if status is FAILURE:",
        "        self.reset_children()",
        "        return status",
        "self.reset_children()",
        "return SUCCESS",
    ],
    NodeType.DECORATOR: [
        "# TODO: decide when the child is ticked, and what its result means",
        "self.set_status(RUNNING)",
        "return self.child.execute_tick()",
    ],
}
_IMPORTED: Final = (
    "FAILURE", "RUNNING", "SUCCESS", "Condition", "ControlNode", "DecoratorNode", "Direction", "In", "InOut",
    "Out", "Port", "Put", "Registry", "Status", "SyncAction", "action", "condition",
)  # fmt: skip
_TAKEN: Final = frozenset({*dir(builtins), *_IMPORTED, *_OF_VALUES, "Annotated", "register", "values"})
"""Names with another meaning in the code."""


def leaf_of(project: Project, source: SourceDocument, id: str) -> Leaf:
    """Return the Python code of a node without code, and a test of it.

    Args:
        source: A document that contains or uses the model.
        id: The ID of the node.

    Raises:
        EditError: There is no such node, it has code, or Python code cannot have its ports.
    """
    reading = read_trees(project, source)
    manifest = reading.nodes.get(id, reading.definitions.format)
    if manifest is None or manifest.type not in _BASES:
        raise EditError(f"there is no node '{id}': write its model first")
    if not is_mock(manifest.cls):
        raise EditError(f"the node '{id}' has code already")
    for port in manifest.ports.values():
        if error := port_name_error(port.name):
            raise EditError(f"nodes in Python cannot have a port '{port.name}': {error}")
    stem = f"{_snake_case(id)}_node"
    return Leaf(f"{stem}.py", _code(manifest), f"test_{stem}.py", _test(manifest, stem))


def _snake_case(id: str) -> str:
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", id)
    return (re.sub(r"\W", "_", normalize("NFKC", words)).lower().strip("_") or "my")[:_MAX_NAME]


def _is_name(name: str) -> bool:
    """Return whether *name* is a name in Python that has no other meaning in the code."""
    return (
        name.isidentifier()
        and not iskeyword(name)
        and name not in _TAKEN
        and not name.startswith("_")
        and normalize("NFKC", name) == name
    )


def _is_attribute(name: str) -> bool:
    """Return whether a port can be an attribute of a class: the engine uses no attribute of this name."""
    return _is_name(name) and not any(
        hasattr(cls, name) or name in getattr(cls, "__annotations__", ())
        for base in _BASES.values()
        for cls in base.__mro__
    )


def _type(port: Port) -> tuple[str, str]:
    """Return the annotation of a port, and a value for the test."""
    # The Python type of a port is `object` if its default is no text of the type that the model names.
    return _ANY if port.type.python_type is object else _TYPES.get(port.type.name, _ANY)


def _key(port: Port) -> str | None:
    """Return the entry that the test binds a port to; None for a port with another default."""
    return port.name if port.default is None else remapped_key(port.default, port.name)


def _code(manifest: Manifest) -> str:
    ports = sorted(manifest.ports.values(), key=lambda port: port.default is not None)
    if not takes_children(manifest) and all(
        _is_name(port.name) and port.direction is not Direction.INOUT for port in ports
    ):
        lines = _function(manifest, ports)
    else:
        lines = _class(manifest, ports)
    return _module(f'"""The node {manifest.id}."""', lines)


def _function(manifest: Manifest, ports: list[Port]) -> list[str]:
    name = _snake_case(manifest.id)
    name = name if _is_name(name) else f"node_{name}"
    decorator = "action" if manifest.type is NodeType.ACTION else "condition"
    parameters = [f"    {_declaration(port, 'Put', ',')}" for port in ports]
    start = [f"def {name}(", *parameters, ") -> Status:"] if ports else [f"def {name}() -> Status:"]
    body = [f"    {line}" for line in (_docstring(manifest), *_BODIES[manifest.type])]
    return [f'@{decorator}(ID="{manifest.id}")', *start, *body]


def _class(manifest: Manifest, ports: list[Port]) -> list[str]:
    is_id = _is_name(manifest.id)
    name = manifest.id if is_id else "Node"
    lines = [f"class {name}({_BASES[manifest.type].__name__}):", f"    {_docstring(manifest)}", ""]
    if ports and all(_is_attribute(port.name) for port in ports):
        lines += [*(f"    {_declaration(port, 'Out')}" for port in ports), ""]
    elif ports:
        lines += ["    @staticmethod", "    def provided_ports() -> list[Port]:", "        return ["]
        lines += [f"            {_port(port)}," for port in ports]
        lines += ["        ]", ""]
    lines += ["    def tick(self) -> Status:", *(f"        {line}" for line in _BODIES[manifest.type])]
    if not is_id:
        lines += ["", "", "def register(nodes: Registry) -> None:"]
        lines += ['    """Register the node."""', f'    nodes.add({name}, ID="{manifest.id}")']
    return lines


def _docstring(manifest: Manifest) -> str:
    about = manifest.description.translate({ord("\\"): "/", ord('"'): "'"})
    return f'"""{" ".join(about.split()) or f"TODO: describe {manifest.id}."}"""'


def _declaration(port: Port, output: str, end: str = "") -> str:
    """Return the declaration of a parameter or an attribute, with *end* before a comment."""
    form = {Direction.IN: "In", Direction.OUT: output, Direction.INOUT: "InOut"}[port.direction]
    annotation = f"{form}[{_type(port)[0]}]"
    if port.description:
        annotation = f"Annotated[{annotation}, {port.description!r}]"
    if port.default is None:
        return f"{port.name}: {annotation}{end}"
    default = _default(port)
    is_text = default == repr(port.default)
    # The default is a text or a key, whatever the type of the port.
    is_other_type = is_text and (form == "Put" or _type(port)[0] not in ("str", "object"))
    comment = "  # type: ignore[assignment]" if is_other_type else ""
    return f"{port.name}: {annotation} = {default}{end}{comment}"


def _default(port: Port) -> str:
    text = port.default or ""
    is_literal = remapped_key(text, port.name) is None and port.direction is not Direction.OUT
    if is_literal and isinstance(port.type, (BoolType, IntegerType, RealType)):
        with suppress(BtcoreError, ValueError):
            value = float(text) if isinstance(port.type, RealType) else port.type.from_text(text)
            if not isinstance(value, float) or math.isfinite(value):
                return repr(value)
    return repr(text)


def _port(port: Port) -> str:
    arguments = [repr(port.name), f"Direction.{port.direction.name}"]
    known = next((name for name in values.__all__ if getattr(values, name) is port.type), None)
    arguments += [f"type=values.{known}"] if known else []
    arguments += [f"default={port.default!r}"] if port.default is not None else []
    arguments += [f"description={port.description!r}"] if port.description else []
    return f"Port({', '.join(arguments)})"


def _module(docstring: str, lines: list[str]) -> str:
    """Return a module with the imports that its code needs."""
    code = "\n".join(lines)
    used = {node.id for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Name)}
    names = [name for name in (*_IMPORTED, "values") if name in used]
    imports = ["from typing import Annotated", ""] if "Annotated" in used else []
    imports.append(f"from btcore import {', '.join(names)}")
    of_values = [name for name in _OF_VALUES if name in used]
    if of_values:
        imports.append(f"from btcore.values import {', '.join(of_values)}")
    return "\n".join([docstring, "", *imports, "", "", code, ""])


def _test(manifest: Manifest, stem: str) -> str:
    needed = [port for port in manifest.ports.values() if port.default is None]
    attributes = "".join(f' {port.name}="{{{port.name}}}"' for port in needed)
    tag = f'{TAG_OF[manifest.type]} ID="{manifest.id}"{attributes}'
    children = {NodeType.CONTROL: "<AlwaysSuccess/> <AlwaysSuccess/>", NodeType.DECORATOR: "<AlwaysSuccess/>"}
    inner = children.get(manifest.type)
    node = f"<{tag}/>" if inner is None else f"<{tag}> {inner} </{TAG_OF[manifest.type]}>"
    keys = {port: _key(port) for port in manifest.ports.values() if port.reads}
    given = [f"    harness.blackboard[{key!r}] = {_type(port)[1]}" for port, key in keys.items() if key]
    return "\n".join(
        [
            f'"""Test the node {manifest.id}."""',
            "",
            "from pathlib import Path",
            "",
            "from btcore import SUCCESS, Registry",
            "from btcore.testing import Harness",
            "",
            'TREE = """',
            '<root BTCPP_format="4">',
            '  <BehaviorTree ID="Main">',
            f"    {node}",
            "  </BehaviorTree>",
            "</root>",
            '"""',
            "",
            "",
            f"def test_{stem}() -> None:",
            "    nodes = Registry.standard()",
            f'    nodes.add_plugin(Path(__file__).with_name("{stem}.py"))',
            "    harness = Harness.loads(TREE, nodes=nodes)",
            *given,
            "    assert harness.run() is SUCCESS",
            "",
        ]
    )
