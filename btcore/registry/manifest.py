"""The manifest of a registered node: its class or function, its ports, and how to create a node."""

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from btcore import builds
from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.ports import UNSET, Input, Port
from btcore.clock import Clock
from btcore.engine.context import TreeContext
from btcore.engine.control import ControlNode, DecoratorNode, enable_child_reset
from btcore.engine.functions import (
    BoundFunction,
    FunctionAction,
    FunctionCondition,
    FunctionCoroutineAction,
    leaf_class,
)
from btcore.engine.leaf import PORT_PLACEHOLDER
from btcore.engine.node import TreeNode, attach_to_tree
from btcore.engine.node_config import NO_INPUTS, NodeConfig
from btcore.engine.node_spec import NodeSpec
from btcore.engine.signature import (
    Parameter,
    bind_class,
    class_ports,
    function_parameters,
    name_or_config_hint,
)
from btcore.errors import NodeError, RegistrationError
from btcore.registry.registration_checks import (
    check_class,
    check_id,
    check_methods,
    check_ports,
    check_source,
)
from btcore.registry.resources import Resources, bind_resources, class_resources, is_tree_resource
from btcore.status import NodeType
from btcore.values import TypeRegistry


class Manifest:
    """The registration of one node.

    Attributes:
        id: The registration ID.
        cls: The class of the nodes.
        spec: What the class declares about its nodes.
        type: The node type.
        ports: The ports by name, in the order of their declaration.
        parameters: The parameters of the function or of `__init__`.
        resource_attributes: The attributes of a class that are filled with resources.
        library: The name of the library that registered the node.
        function: The function that the nodes call; None for a node class.
        metadata: Texts by name for other tools, such as an editor. They are written to the TreeNodesModel.
            A class declares them with a static method `metadata()`, as in C++.
    """

    def __init__(
        self,
        id: str,
        cls: type[TreeNode],
        ports: Sequence[Port],
        parameters: Sequence[Parameter],
        library: str,
        function: Callable[..., object] | None = None,
        resource_attributes: Sequence[Parameter] = (),
    ) -> None:
        self.id = id
        self.cls = cls
        self.spec: NodeSpec = cls.spec
        self.type: NodeType = self.spec.node_type
        self.ports = {port.name: port for port in ports}
        self.parameters = list(parameters)
        self.resource_attributes = list(resource_attributes)
        self.library = library
        self.function = function
        self.metadata = _class_metadata(cls)
        self._has_init = bool(self.parameters) or _has_own_init(cls)
        self._has_children = issubclass(cls, (ControlNode, DecoratorNode))
        self._overrides_prepare = cls.prepare is not TreeNode.prepare

    @property
    def description(self) -> str:
        """The description of the node: the docstring of its class or function."""
        if self.function is not None:
            return inspect.cleandoc(self.function.__doc__ or "")
        return inspect.cleandoc(self.cls.__doc__ or builds.written_docstring(self.cls))

    @property
    def resource_parameters(self) -> list[Parameter]:
        """The parameters and the attributes that are filled with resources."""
        parameters = [parameter for parameter in self.parameters if parameter.port is None]
        return [*parameters, *self.resource_attributes]

    @property
    def required_resources(self) -> list[Any]:
        """The types of the resources that the caller of load() must pass for a node."""
        return [
            parameter.resource_type
            for parameter in self.resource_parameters
            if parameter.default is UNSET
            and parameter.resource_type not in (Clock, Blackboard)
            and not is_tree_resource(parameter.resource_type)
        ]

    def has_same_origin(self, other: "Manifest") -> bool:
        """Return whether *other* has the same class or function, even if it was imported twice."""
        mine, its = self.function or self.cls, other.function or other.cls
        return mine is its or self.origin == other.origin

    @property
    def origin(self) -> str:
        """`name (file:line)` of the class or function."""
        implementation: Any = self.function or self.cls
        try:
            line = inspect.getsourcelines(implementation)[1]
            return f"{implementation.__qualname__} ({inspect.getsourcefile(implementation)}:{line})"
        except (OSError, TypeError):
            return f"{implementation.__qualname__} of {self.library}"

    def create_node(
        self,
        config: NodeConfig,
        context: TreeContext,
        blackboard: Blackboard,
        resources: Resources,
        children: list[TreeNode],
    ) -> TreeNode:
        """Create a node with *children*, which were created before, in the scope *blackboard*."""
        cls = self.cls
        # __init__ is called below, when the node has its ports, blackboard and children.
        node: TreeNode = cls.__new__(cls)
        attach_to_tree(node, config, context, blackboard)
        if self._has_children:
            assert isinstance(node, (ControlNode, DecoratorNode))
            node.set_children(children)
        for attribute in self.resource_attributes:
            value = self._resource(attribute, node, resources)
            if value is not UNSET:
                setattr(node, attribute.name, value)
        if self.function is not None:
            call = BoundFunction(self.function, *self._arguments(node, resources))
            assert isinstance(node, (FunctionAction, FunctionCondition, FunctionCoroutineAction))
            node.call = call
        elif self._has_init:
            positional, keywords = self._arguments(node, resources)
            _initialiser(cls)(node, *positional, **keywords)
        if isinstance(node, DecoratorNode):
            enable_child_reset(node)
        if self._overrides_prepare:
            node.prepare()
        return node

    def _arguments(self, node: TreeNode, resources: Resources) -> tuple[list[object], dict[str, object]]:
        positional: list[object] = []
        keywords: dict[str, object] = {}
        inputs = node.config.inputs if self.function is not None else NO_INPUTS
        for parameter in self.parameters:
            port = parameter.port
            # By far the most frequent case: an input port that the tree gives.
            value: object = inputs.get(port.name) if port is not None and port.reads else None
            if value is None:
                value = self._argument(parameter, node, resources)
            if parameter.keyword:
                keywords[parameter.name] = value
            else:
                positional.append(value)
        return positional, keywords

    def _argument(self, parameter: Parameter, node: TreeNode, resources: Resources) -> object:
        port = parameter.port
        if port is not None:
            if self.function is None:
                return PORT_PLACEHOLDER
            if port.writes and not port.reads:
                # Without an output in the XML, calling it raises NodeError.
                return node.config.outputs.get(port.name) or partial(node.set_output, port.name)
            input = node.config.inputs.get(port.name)
            if input is None:
                if port.default_value is not UNSET:
                    return port.default_value
                return _MissingInput(port, node)
            return input
        value = self._resource(parameter, node, resources)
        if value is UNSET:
            from btcore.suggestions import with_article  # for this message alone

            needed = with_article(parameter.type_name)
            message = f"<{self.id}> needs {needed} for its parameter '{parameter.name}': "
            name_hint = name_or_config_hint(parameter.name) if self.function is None else ""
            message += name_hint or resources.explain_missing(parameter)
            if parameter.looks_like_port and not name_hint:
                message += f"; if it is a port, mark it: {parameter.name}: In[{parameter.type_name}]"
            raise NodeError(message)
        return value

    def _resource(self, parameter: Parameter, node: TreeNode, resources: Resources) -> object:
        if parameter.resource_type is Clock:
            return node._context.clock
        if parameter.resource_type is Blackboard:
            return node._blackboard
        return resources.find_or_create(parameter, self.id)


def takes_children(manifest: Manifest) -> bool:
    """Return whether a node of *manifest* is not a leaf."""
    return manifest.type not in (NodeType.ACTION, NodeType.CONDITION)


class _MissingInput(Input):
    """A mandatory input port that the XML does not give; reading it raises NodeError."""

    def __init__(self, port: Port, node: TreeNode) -> None:
        super().__init__(port, "")
        self.node = node

    def read(self) -> object:
        return self.node.get_input(self.name)


def create_manifest(
    id: str,
    implementation: type[TreeNode] | Callable[..., object],
    types: TypeRegistry,
    names: Mapping[str, Any],
    library: str,
    format: int = 4,
) -> Manifest:
    """Return the manifest of a node class, or of a function as a leaf.

    Args:
        types: The types that ports may have.
        names: Local names, for resolving annotations that are strings.
        library: The name of the library that registers the node.
        format: The XML format whose rules for port names apply.
    """
    check_id(id)
    if isinstance(implementation, type):
        check_source(id, implementation)
        ports = class_ports(implementation, types.of, names)
        check_ports(id, ports, format)
        check_class(id, implementation)
        check_methods(id, implementation)
        parameters = []
        if _has_own_init(implementation):
            initialiser = _initialiser(implementation)
            parameters = function_parameters(initialiser, types.of, names, skip_first=True)
        attributes = class_resources(implementation, names, {parameter.name for parameter in parameters})
        # After all checks, because it changes the class.
        bind_class(implementation, ports)
        bind_resources(implementation, attributes)
        return Manifest(id, implementation, ports, parameters, library, resource_attributes=attributes)
    if inspect.isasyncgenfunction(implementation):
        raise RegistrationError(
            f"{implementation.__qualname__} is an async def that yields; await running() instead of the "
            "yield, or make it a plain generator"
        )
    parameters = function_parameters(implementation, types.of, names)
    outputs = [item.name for item in parameters if item.port is not None and not item.port.reads]
    check_source(id, implementation, outputs)
    ports = [parameter.port for parameter in parameters if parameter.port is not None]
    check_ports(id, ports, format)
    return Manifest(id, leaf_class(implementation), ports, parameters, library, implementation)


def _class_metadata(cls: type) -> dict[str, str]:
    """Return the result of the static method or class method `metadata`; {} if the class has none."""
    # Any other attribute of this name, such as a method or a port, has another meaning.
    if not isinstance(inspect.getattr_static(cls, "metadata", None), (staticmethod, classmethod)):
        return {}
    metadata: dict[str, str] = {str(name): str(text) for name, text in cls.metadata().items()}  # type: ignore[attr-defined]
    for name in metadata:
        if re.fullmatch(r"[^\W\d][\w.:-]*", name) is None:
            message = f"invalid name {name!r} in the metadata of {cls.__qualname__}"
            raise RegistrationError(f"{message}: use letters, digits, '_', '-' and '.'")
    return metadata


def _initialiser(cls: type) -> Callable[..., None]:
    # type.__getattribute__, because mypy rejects cls.__init__ as unsound.
    initialiser: Callable[..., None] = type.__getattribute__(cls, "__init__")
    return initialiser


def _has_own_init(cls: type) -> bool:
    initialiser = _initialiser(cls)
    # A Protocol among the base classes adds an __init__ of typing, which has no effect on a node.
    return initialiser not in (_initialiser(object), _initialiser(TreeNode)) and (
        getattr(initialiser, "__module__", "") != "typing"
    )
