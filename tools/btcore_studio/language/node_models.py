"""Descriptions of nodes that cross the border between processes: their ports, documentation and source."""

import inspect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

from btcore.blackboard.ports import Direction, Port, PortRole
from btcore.engine.node_spec import NodeSpec
from btcore.registry.manifest import Manifest
from btcore.registry.nodes_without_code import create_mock_class, is_mock
from btcore.registry.registration_checks import default_value_error
from btcore.registry.registry import Registry
from btcore.status import NodeType
from btcore.values import EnumType, ValueType
from btcore_studio.language.descriptions import is_mandatory


@dataclass(frozen=True, slots=True)
class PortModel:
    """A port.

    Attributes:
        name: The name.
        direction: "input", "output" or "inout".
        type: The name of the type, as in a TreeNodesModel.
        default: The default as text; None = the port is mandatory.
        description: The description, or "".
        optional: Whether the node works without the port although it has no default text.
        members: The members of an enum with their numbers.
        role: The name of the PortRole.
    """

    name: str
    direction: str = "input"
    type: str = "BT::AnyTypeAllowed"
    default: str | None = None
    description: str = ""
    optional: bool = False
    members: dict[str, int] = field(default_factory=dict)
    role: str = "VALUE"


@dataclass(frozen=True, slots=True)
class NodeModel:
    """A node that is not built in.

    Attributes:
        id: The registration ID.
        type: The name of the NodeType, such as "ACTION".
        ports: The ports.
        description: The documentation, or "".
        distribution: The package or the file that provides the node.
        file: The file of the source, or "".
        line: The line of the source, from 1; 0 = unknown.
        format: 3 or 4 = the node exists in this XML format only; 0 = in both.
        symbol: The symbol that drawings show, or "".
        metadata: Texts by name for other tools.
    """

    id: str
    type: str
    ports: tuple[PortModel, ...] = ()
    description: str = ""
    distribution: str = ""
    file: str = ""
    line: int = 0
    format: int = 0
    symbol: str = ""
    metadata: dict[str, str] = field(default_factory=dict)

    def as_data(self) -> dict[str, Any]:
        """Return the model as JSON data."""
        return asdict(self)

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> "NodeModel":
        """Return the model for the result of `as_data`."""
        ports = tuple(PortModel(**port) for port in data["ports"])
        return cls(**{**data, "ports": ports})


def models_of(nodes: Registry) -> list[NodeModel]:
    """Return the nodes of a registry that are not built in."""
    builtin = Registry.standard()
    models: list[NodeModel] = []
    of_4 = {id: item for id, item in nodes.manifests_of(4).items() if builtin.get(id, 4) is None}
    of_3 = {id: item for id, item in nodes.manifests_of(3).items() if builtin.get(id, 3) is None}
    for id, manifest in of_4.items():
        models.append(_model_of(manifest, 0 if of_3.get(id) is manifest else 4))
    models += [_model_of(manifest, 3) for id, manifest in of_3.items() if of_4.get(id) is not manifest]
    return models


def add_mock_nodes(nodes: Registry, models: Iterable[NodeModel], enums: Mapping[str, int]) -> None:
    """Register a mock node for each model. A model whose ID is registered already is ignored.

    Args:
        nodes: The registry to extend.
        enums: The enum names to register.
    """
    for name, number in enums.items():
        if nodes.types.enums.get(name, number) == number:
            nodes.types.add_enum({name: number})
    for model in models:
        formats = (model.format,) if model.format else (3, 4)
        if any(nodes.get(model.id, format) is not None for format in formats):
            continue
        ports = [_port(nodes, port) for port in model.ports]
        origin = model.distribution or "model"
        node_type = NodeType[model.type]
        cls = create_mock_class(model.id, node_type, ports, model.description, origin, model.metadata)
        cls.spec = NodeSpec(symbol=model.symbol)
        nodes.add(cls, ID=model.id, format=model.format or None)


def _model_of(manifest: Manifest, format: int) -> NodeModel:
    file, line = _source_of(manifest)
    return NodeModel(
        manifest.id,
        manifest.type.name,
        tuple(_port_model(manifest, port) for port in manifest.ports.values()),
        manifest.description,
        manifest.library,
        file,
        line,
        format,
        manifest.spec.symbol,
        dict(manifest.metadata),
    )


def _source_of(manifest: Manifest) -> tuple[str, int]:
    code: Any = manifest.function or manifest.cls
    if is_mock(manifest.cls):
        return "", 0
    try:
        return inspect.getsourcefile(code) or "", inspect.getsourcelines(code)[1]
    except (OSError, TypeError):
        return "", 0


def _port_model(manifest: Manifest, port: Port) -> PortModel:
    is_needed = port.reads if is_mock(manifest.cls) else is_mandatory(manifest, port)
    return PortModel(
        port.name,
        port.direction.value,
        port.type.name,
        port.default,
        port.description,
        port.optional or (port.default is None and not is_needed),
        _members(port.type),
        port.role.name,
    )


def _members(value_type: ValueType) -> dict[str, int]:
    if not isinstance(value_type, EnumType):
        return {}
    numbers = [(member.name, member.value) for member in value_type.members]
    return {name: value if isinstance(value, int) else index for index, (name, value) in enumerate(numbers)}


def _port(nodes: Registry, model: PortModel) -> Port:
    port = Port(
        model.name,
        Direction(model.direction),
        type_named(nodes, model.type, model.members),
        model.default,
        model.description,
        role=PortRole[model.role],
        optional=model.optional,
    )
    if default_value_error(port):
        port.default_value = None  # the default is a Python value, which the text does not determine
    return port


def type_named(nodes: Registry, name: str, members: Mapping[str, int] | Sequence[str] = ()) -> ValueType:
    """Return the type with this name; an unknown name becomes a new type without conversion.

    Args:
        nodes: The registry with the known types.
        name: The name of the type.
        members: The members of an enum.
    """
    known = nodes.types.named(name)
    if known is not None:
        return known
    if members:
        make: Any = Enum  # the functional API: mypy supports it for constants only
        enum_class = make(name.rpartition(".")[2], members)
        return EnumType(enum_class, name, nodes.types.enums)
    return ValueType(name, object, converts=False)


def find_model_files(pattern: str, folders: Sequence[Path]) -> list[Path]:
    """Return the files that match a pattern of the setting `models`."""
    try:
        return [path for folder in folders for path in sorted(folder.glob(pattern))]
    except (ValueError, NotImplementedError):  # an empty or an absolute pattern
        return [Path(pattern)]
