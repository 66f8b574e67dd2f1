"""The resources of a tree: the objects that its leaves get by the types of their parameters and attributes.

A node class declares a resource as an annotated attribute without a value, such as `lamp: Lamp`.
"""

import inspect
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, Final, TypeGuard

from btcore.blackboard.ports import UNSET
from btcore.engine.signature import Parameter, class_annotations, hides_attribute
from btcore.errors import NodeError
from btcore.names import PLUGIN_FILE_PREFIX
from btcore.suggestions import with_article

_ENGINE: Final = "btcore"
_NEVER_RESOURCES: Final = frozenset({"builtins", "collections", "collections.abc", "typing"})
"""The modules whose classes are types of values."""

TypeRef = type | str
"""A class or protocol whose objects are provided or needed, or its full name, if it is not imported."""


class TreeResource:
    """The base class of resources that belong to one tree, and that its leaves share.

    A leaf whose function or `__init__` has a parameter of a subclass gets the instance that belongs to the
    tree. The instance is created, without arguments, for the first such leaf of the tree.

    Examples:
        >>> import btcore
        >>> class Visits(btcore.TreeResource):
        ...     def __init__(self):
        ...         self.places = []
        >>> @btcore.action
        ... def visit(visits: Visits, place: btcore.In[str]):
        ...     visits.places.append(place)
        ...     print(visits.places)
        ...     return True
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(visit)
        >>> b = btcore.Builder(nodes)
        >>> b.build(b.Sequence(b.Visit(place="door"), b.Visit(place="window"))).tick_once()
        ['door']
        ['door', 'window']
        <Status.SUCCESS: 2>
    """


class Resources(list[object]):
    """The objects for the leaves of a tree. A provider with a parameter of this type gets those of the run.

    A leaf gets the object that was assigned to the type of its parameter, else the first that fits.

    Args:
        resources: The objects; from another `Resources`, also what was assigned.

    Attributes:
        missing_note: What messages say about a missing object: what to do, or why it is missing.
    """

    def __init__(self, resources: Iterable[object] = ()) -> None:
        super().__init__(resources)
        # The assigned and the found objects, by the types of the parameters; UNSET if none fits.
        self._by_type: dict[Any, object] = {}
        self.missing_note = "pass it in resources=[…]"
        if isinstance(resources, Resources):
            self._by_type.update(resources._by_type)
            self.missing_note = resources.missing_note

    def assign(self, resource_type: Any, resource: object) -> None:
        """Assign the object that leaves get for a type.

        Args:
            resource_type: The type.
            resource: The object.
        """
        self._by_type[resource_type] = resource

    def find_or_create(self, parameter: Parameter, id: str) -> object:
        """Return the resource for a parameter, else the default of the parameter, or UNSET.

        A missing `TreeResource` is created, and added to the resources.

        Args:
            parameter: The parameter.
            id: The ID of its leaf, for messages.

        Raises:
            NodeError: As `first_of`.
        """
        resource_type = parameter.resource_type
        if resource_type not in self._by_type:
            use = f"the {'attribute' if parameter.is_attribute else 'parameter'} '{parameter.name}' of <{id}>"
            try:
                resource = self.first_of(resource_type, use)
            except NodeError as error:
                raise NodeError(f"{error}{parameter.own_state_hint}") from None
            if resource is UNSET and is_tree_resource(resource_type):
                resource = resource_type()
                self.append(resource)
            self._by_type[resource_type] = resource
        resource = self._by_type[resource_type]
        return parameter.default if resource is UNSET else resource

    def first_of(self, resource_type: Any, use: str) -> object:
        """Return the first resource that fits a type, or UNSET.

        Args:
            resource_type: The type.
            use: What needs the resource, for messages: "the parameter 'lamp' of <Blink>".

        Raises:
            NodeError: Other resources of the same class fit, too: the choice between them would be arbitrary.
                Or isinstance() does not support the type.
        """
        try:
            fitting = [resource for resource in self if isinstance(resource, resource_type)]
        except TypeError:
            name = getattr(resource_type, "__name__", resource_type)
            raise NodeError(
                f"{use} has the type {name}, which isinstance() does not support: use a "
                "class, or a Protocol marked @runtime_checkable"
            ) from None
        if problem := describe_ambiguity(fitting, use):
            raise NodeError(problem)
        return fitting[0] if fitting else UNSET

    def explain_missing(self, parameter: Parameter) -> str:
        """Return why the resource for *parameter* is missing, or what to do about it.

        A file that is both imported and loaded as a plugin exists as two modules, each with its own classes.
        """
        resource_type = parameter.resource_type
        for cls in map(type, self):
            if isinstance(resource_type, type) and cls.__qualname__ == resource_type.__qualname__:
                module = cls.__module__
                if resource_type.__module__ == f"{PLUGIN_FILE_PREFIX}{module}":
                    return (
                        f"resources contains a {cls.__qualname__} of the imported module '{module}', but "
                        f'add_plugin loaded {module}.py a second time: write add_plugin("{module}")'
                    )
                return (
                    f"resources contains a {cls.__qualname__} of the module '{module}', "
                    f"but the leaf needs the class of '{resource_type.__module__}'"
                )
        return self.missing_note


def full_name(type: TypeRef) -> str:
    """Return the module and the qualified name of a type."""
    if isinstance(type, str):
        return type
    return f"{getattr(type, '__module__', '?')}.{getattr(type, '__qualname__', type)}"


def fits(resource: object, needed: TypeRef) -> bool:
    """Return whether an object is of a type, or satisfies it as a protocol."""
    if full_name(needed) in map(full_name, type(resource).__mro__):
        return True
    try:
        return isinstance(resource, needed)  # type: ignore[arg-type]
    except TypeError:  # a full name, or a protocol that is not checked at run time
        return False


def describe_ambiguity(fitting: Sequence[object], use: str) -> str:
    """Return why the choice of the first of *fitting* for *use* would be arbitrary, or ""."""
    # A resource may be listed twice.
    count = len({id(resource) for resource in fitting if type(resource) is type(fitting[0])})
    if count <= 1:
        return ""
    return (
        f"{count} resources of the class {type(fitting[0]).__name__} fit {use}: "
        "pass only one of them, or give each a class of its own"
    )


def is_tree_resource(resource_type: object) -> TypeGuard[type[TreeResource]]:
    """Return whether a type is a subclass of TreeResource, of which every tree creates its own instance."""
    return isinstance(resource_type, type) and issubclass(resource_type, TreeResource)


class MissingResourceError(NodeError, AttributeError):
    """An attribute was read for which the tree has no resource."""


class ResourceAttribute:
    """A class attribute whose value nodes get when they are created. Reading it before raises an error."""

    def __init__(self, parameter: Parameter) -> None:
        self.parameter = parameter

    def __get__(self, node: Any, cls: type) -> object:
        """Raise MissingResourceError. A value of the node itself takes precedence."""
        if node is None:
            return self
        name, type_name = self.parameter.name, self.parameter.type_name
        raise MissingResourceError(
            f"<{node.config.id}> needs {with_article(type_name)} for its attribute '{name}': pass it in "
            f"resources=[…]; if it is a port, mark it: {name}: In[{type_name}]{self.parameter.own_state_hint}"
        )


def class_resources(cls: type, names: Mapping[str, Any], given: Collection[str]) -> list[Parameter]:
    """Return the attributes of a node class that are filled with resources, by their types.

    These are the public attributes that are annotated with a class and have no value in the class. Built-in
    classes, and those of `typing` and `collections`, are types of values.

    Args:
        names: Local names, for resolving annotations that are strings.
        given: The names of the parameters of `__init__`, which are passed to it instead.
    """
    parents = [parent for parent in cls.__mro__ if parent.__module__.partition(".")[0] != _ENGINE]
    declared = {name for parent in parents for name in inspect.get_annotations(parent)}
    # A dataclass removes the values of its fields from the class.
    declared.difference_update(given, getattr(cls, "__dataclass_fields__", ()))
    return [
        Parameter(name, True, None, resource_type, UNSET, is_attribute=True)
        for name, resource_type in class_annotations(cls, names).items()
        if name in declared and isinstance(resource_type, type)
        if resource_type.__module__ not in _NEVER_RESOURCES
        if not name.startswith("_") and not _has_value(cls, name)
    ]


def _has_value(cls: type, name: str) -> bool:
    value = getattr(cls, name, UNSET)
    if value is UNSET or hides_attribute(name, value):
        return False
    return not isinstance(value, ResourceAttribute)


def bind_resources(cls: type, attributes: Iterable[Parameter]) -> None:
    """Make *attributes*, the result of `class_resources`, attributes of *cls* that report a missing value."""
    for parameter in attributes:
        setattr(cls, parameter.name, ResourceAttribute(parameter))
