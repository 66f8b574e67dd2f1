"""What is registered under one ID: what it is, its ports, and how to make one."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeGuard

from btcore import builds
from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.ports import UNSET, Input, Port
from btcore.clock import Clock
from btcore.engine.context import TreeContext, TreeState
from btcore.engine.control import ControlNode, DecoratorNode
from btcore.engine.functions import (
    BoundFunction,
    FunctionAction,
    FunctionCondition,
    FunctionCoroutineAction,
    leaf_class,
)
from btcore.engine.node import TreeNode
from btcore.engine.node_config import NO_INPUTS, NodeConfig
from btcore.engine.port_attributes import PORT_PLACEHOLDER
from btcore.engine.signature import (
    Parameter,
    bind_class,
    class_ports,
    function_parameters,
)
from btcore.errors import NodeError, RegistrationError
from btcore.registry.registration_checks import (
    check_class,
    check_id,
    check_methods,
    check_ports,
)
from btcore.status import NodeType
from btcore.values import TypeRegistry


class Manifest:
    """One entry of a registry.

    *ports* are in the order of declaration; *wanted* are the types of the resources that it asks for;
    *distribution* is the package that brought it, and *origin* the class or function and its place. One that
    *yields* came along with an installed package, and gives way to what a user registers under its ID.
    """

    is_overridable = False

    def __init__(
        self,
        id: str,
        cls: type[TreeNode],
        ports: Sequence[Port],
        parameters: Sequence[Parameter],
        distribution: str,
        function: Callable[..., object] | None = None,
    ) -> None:
        self.id = id
        self.cls = cls
        self.ports = {port.name: port for port in ports}
        self.parameters = list(parameters)
        self.distribution = distribution
        self.function = function
        self._has_init = bool(self.parameters) or _has_own_init(cls)
        self._adopts = issubclass(cls, (ControlNode, DecoratorNode))
        self._prepares = cls.prepare is not TreeNode.prepare

    @property
    def type(self) -> NodeType:
        """The family of the node."""
        return self.cls.node_type

    @property
    def description(self) -> str:
        """What the node does: the docstring of what is registered."""
        if self.function is not None:
            return inspect.cleandoc(self.function.__doc__ or "")
        return inspect.cleandoc(self.cls.__doc__ or builds.written_docstring(self.cls))

    @property
    def required_resources(self) -> list[Any]:
        """The types of the resources that must be handed in."""
        return [
            one.resource_type
            for one in self.parameters
            if one.port is None
            and one.default is UNSET
            and one.resource_type not in (Clock, Blackboard)
            and not is_tree_state(one.resource_type)
        ]

    def same_thing(self, other: "Manifest") -> bool:
        """Whether both are of one class or function, perhaps imported twice."""
        mine, its = self.function or self.cls, other.function or other.cls
        return mine is its or self.origin == other.origin

    @property
    def origin(self) -> str:
        """``name (file:line)`` of what is registered."""
        thing: Any = self.function or self.cls
        try:
            line = inspect.getsourcelines(thing)[1]
            return f"{thing.__qualname__} ({inspect.getsourcefile(thing)}:{line})"
        except (OSError, TypeError):
            return f"{thing.__qualname__} of {self.distribution}"

    def make(
        self,
        config: NodeConfig,
        context: TreeContext,
        blackboard: Blackboard,
        resources: "Resources",
        children: list[TreeNode],
    ) -> TreeNode:
        """A node of a tree. Raises NodeError when a resource that it wants wasn't handed in."""
        cls = self.cls
        node: TreeNode = cls.__new__(cls)
        node.attach_to_tree(config, context, blackboard)
        if self._adopts:
            assert isinstance(node, (ControlNode, DecoratorNode))
            node.set_children(children)
        if self.function is not None:
            call = BoundFunction(self.function, *self._arguments(node, context, resources))
            if isinstance(node, (FunctionAction, FunctionCondition, FunctionCoroutineAction)):
                node.call = call
        elif self._has_init:
            positional, keywords = self._arguments(node, context, resources)
            _initialiser(cls)(node, *positional, **keywords)
        if isinstance(node, DecoratorNode):
            # Only now, since adopt() and __init__ may be a user's.
            node._decorated = node.child
        if self._prepares:
            node.prepare()
        return node

    def _arguments(
        self, node: TreeNode, context: TreeContext, resources: "Resources"
    ) -> tuple[list[object], dict[str, object]]:
        """What fills the parameters: by position, and by name."""
        positional: list[object] = []
        keywords: dict[str, object] = {}
        inputs = node.config.inputs if self.function is not None else NO_INPUTS
        for parameter in self.parameters:
            port = parameter.port
            # The most frequent case by far.
            value: object = inputs.get(port.name) if port is not None and port.reads else None
            if value is None:
                value = self._fill(parameter, node, context, resources)
            if parameter.keyword:
                keywords[parameter.name] = value
            else:
                positional.append(value)
        return positional, keywords

    def _fill(
        self, parameter: Parameter, node: TreeNode, context: TreeContext, resources: "Resources"
    ) -> object:
        port = parameter.port
        if port is not None:
            if self.function is None:
                return PORT_PLACEHOLDER
            if port.writes and not port.reads:
                return node.config.outputs.get(port.name) or _Unconnected(node, port.name)
            bound = node.config.inputs.get(port.name)
            if bound is None:
                if port.value is not UNSET:
                    return port.value
                return _MissingInput(port, node)
            return bound
        if parameter.resource_type is Clock:
            return context.clock
        if parameter.resource_type is Blackboard:
            return node.blackboard
        try:
            value = resources.of(parameter)
        except TypeError:
            raise NodeError(
                f"the parameter '{parameter.name}' of <{self.id}> is of type {parameter.type_name}, by which "
                "nothing can be found: use a class, or a Protocol marked @runtime_checkable"
            ) from None
        if value is UNSET:
            said = (
                f"<{self.id}> wants a {parameter.type_name} (its parameter '{parameter.name}'), "
                "and none was handed in: pass one in resources=[…]"
            )
            if parameter.looks_like_port:
                said += f"; if it is a port, mark it: {parameter.name}: In[{parameter.type_name}]"
            raise NodeError(said)
        return value


class Resources(list[object]):
    """What was handed in for the leaves of one tree; what a parameter takes of it is looked for once."""

    def __init__(self, given: Sequence[object]) -> None:
        super().__init__(given)
        self._found: dict[Parameter, object] = {}

    def of(self, parameter: Parameter) -> object:
        """The first resource that fits *parameter*, else its default, which may be UNSET."""
        if parameter not in self._found:
            self._found[parameter] = self._look_for(parameter)
        return self._found[parameter]

    def _look_for(self, parameter: Parameter) -> object:
        for resource in self:
            if fits(resource, parameter.resource_type):
                return resource
        if is_tree_state(parameter.resource_type):
            made = parameter.resource_type()
            self.append(made)
            return made
        return parameter.default


def is_tree_state(wanted: object) -> TypeGuard[type[TreeState]]:
    """Whether a leaf that asks for *wanted* gets what its tree makes, and nobody hands in."""
    return isinstance(wanted, type) and issubclass(wanted, TreeState)


def takes_children(manifest: Manifest | None) -> bool:
    """Whether a node of *manifest* is no leaf; so is taken a node that nobody knows."""
    return manifest is None or manifest.type not in (NodeType.ACTION, NodeType.CONDITION)


class _Unconnected:
    """An output port that the tree doesn't give; writing it raises."""

    def __init__(self, node: TreeNode, name: str) -> None:
        self.node = node
        self.name = name

    def __call__(self, value: object) -> None:
        self.node.set_output(self.name, value)


class _MissingInput(Input):
    """A mandatory input port that the tree doesn't give; reading it raises."""

    def __init__(self, port: Port, node: TreeNode) -> None:
        super().__init__(port, "")
        self.node = node

    def read(self) -> object:
        """Raises NodeError."""
        return self.node.get_input(self.name)


def fits(resource: object, wanted: Any) -> bool:
    """Whether *resource* is what a parameter of type *wanted* asks for.

    Raises TypeError for a type that nothing can be told to be of, such as a Protocol that isn't marked.
    """
    return isinstance(resource, wanted)


def class_manifest(
    ID: str,
    cls: type[TreeNode],
    types: TypeRegistry,
    names: Mapping[str, Any],
    distribution: str,
    format: int = 4,
) -> Manifest:
    """The manifest of a node class, in trees of *format* at least. Raises RegistrationError."""
    check_id(ID)
    ports = class_ports(cls, types, names)
    check_ports(ID, ports, format)
    check_class(ID, cls)
    check_methods(ID, cls)
    bind_class(cls, ports)
    parameters = []
    if _has_own_init(cls):
        parameters = function_parameters(_initialiser(cls), types, names, skip_first=True)
    return Manifest(ID, cls, ports, parameters, distribution)


def function_manifest(
    ID: str,
    function: Callable[..., object],
    types: TypeRegistry,
    names: Mapping[str, Any],
    distribution: str,
    format: int = 4,
) -> Manifest:
    """The manifest of a function as a leaf, in trees of *format* at least. Raises RegistrationError."""
    check_id(ID)
    if inspect.isasyncgenfunction(function):
        raise RegistrationError(
            f"{function.__qualname__} is an async def that yields; await running() instead of the yield, "
            "or make it a plain generator"
        )
    parameters = function_parameters(function, types, names)
    ports = [one.port for one in parameters if one.port is not None]
    check_ports(ID, ports, format)
    return Manifest(ID, leaf_class(function), ports, parameters, distribution, function)


def _initialiser(cls: type) -> Callable[..., None]:
    found: Callable[..., None] = type.__getattribute__(cls, "__init__")
    return found


def _has_own_init(cls: type) -> bool:
    found = _initialiser(cls)
    # A Protocol among the bases brings an __init__ of typing's, which does nothing for a node.
    return found not in (_initialiser(object), _initialiser(TreeNode)) and (
        getattr(found, "__module__", "") != "typing"
    )
