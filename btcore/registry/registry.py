"""The registry of what a tree may use: built-in nodes, the user's nodes and node libraries, and trees."""

import copy
import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import Enum
from functools import cache
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from btcore import entry_points
from btcore.engine.functions import MARK, camel_case
from btcore.engine.node import TreeNode
from btcore.engine.node_config import NodeConfig
from btcore.entry_points import NODES_GROUP, UnavailableEntryPoint
from btcore.errors import NodeError, RegistrationError
from btcore.names import PLUGIN_FILE_PREFIX
from btcore.nodes.builtin_nodes import BUILTIN_NODES
from btcore.registry.manifest import Manifest, create_manifest
from btcore.status import NodeType
from btcore.suggestions import did_you_mean
from btcore.values import TypeRegistry
from btcore.xml.read.document import Document
from btcore.xml.read.read import parse_file, parse_text


@cache
def _builtin_manifest(id: str, node: type[TreeNode]) -> Manifest:
    """Return the manifest of a built-in node, whose types need no registry. All registries share it."""
    return create_manifest(id, node, TypeRegistry(), {}, "btcore")


class SubstitutionRule:
    """A rule by which nodes that match *filter* are created from *by*, a manifest or a registered node's ID.

    *filter* is a registration ID, an instance name, or a full path in which `*` stands for any text
    and `?` for any character.
    """

    def __init__(self, filter: str, by: Manifest | str) -> None:
        self.filter = filter
        self.by = by
        parts = [".*" if char == "*" else "." if char == "?" else re.escape(char) for char in filter]
        self._path = re.compile("".join(parts), re.DOTALL)

    def matches(self, config: NodeConfig) -> bool:
        """Return whether the rule applies to the node of *config*."""
        return (
            self.filter == config.name
            or self.filter == config.id
            or self._path.fullmatch(config.path) is not None
        )

    def __repr__(self) -> str:
        by = self.by if isinstance(self.by, str) else self.by.cls.__name__
        return f"<SubstitutionRule '{self.filter}' → {by}>"


class Registry:
    """The nodes, types, enums and trees that the XML of a tree may use.

    There is no global registry: create a registry and pass it to `btcore.load`.

    Attributes:
        types: The types of ports and entries, with their converters.
        substitutions: The substitution rules by pattern, see `substitute`.
        documents: The documents of `add_trees`.

    Examples:
        >>> import btcore
        >>> @btcore.action
        ... def greet():
        ...     print("hello")
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(greet)
        >>> "Greet" in nodes, "Sequence" in nodes
        (True, True)
    """

    def __init__(self) -> None:
        self.types = TypeRegistry()
        # The nodes of each format by ID, and those of installed libraries, which the others override. A
        # built-in node is stored as its class, because creating a manifest takes time.
        self._nodes: dict[int, dict[str, Manifest | type[TreeNode]]] = {3: {}, 4: {}}
        self._installed: dict[int, dict[str, Manifest | type[TreeNode]]] = {3: {}, 4: {}}
        self._libraries: list[str] = []
        self.substitutions: dict[str, SubstitutionRule] = {}
        self.documents: list[Document] = []

    @classmethod
    def standard(cls) -> "Registry":
        """Return a new registry of the built-in nodes: of BehaviorTree.CPP 4.10, or of 3.8 in format 3."""
        registry = cls()
        for format, nodes in BUILTIN_NODES.items():
            registry._nodes[format].update(nodes)
        registry._libraries.append("btcore")
        return registry

    def copy(self) -> "Registry":
        """Return a new registry with the same nodes, trees and substitution rules.

        Types and enums are shared.
        """
        registry = copy.copy(self)
        registry._nodes = {format: dict(nodes) for format, nodes in self._nodes.items()}
        registry._installed = {format: dict(nodes) for format, nodes in self._installed.items()}
        registry._libraries = list(self._libraries)
        registry.substitutions = dict(self.substitutions)
        registry.documents = list(self.documents)
        return registry

    def _library_layer(self) -> "Registry":
        """Return a registry with the same trees and rules, which adds to the nodes of installed libraries."""
        layer = copy.copy(self)
        layer._nodes, layer._installed = self._installed, self._nodes
        layer.types = self.types.library_layer()
        return layer

    # --- lookup

    def manifests_of(self, format: int) -> Mapping[str, Manifest]:
        """Return the nodes that a tree of *format* (3 or 4) may use, by ID, sorted."""
        ids = sorted(self._nodes[format] | self._installed[format])
        return {id: manifest for id in ids if (manifest := self.get(id, format)) is not None}

    @property
    def manifests(self) -> Mapping[str, Manifest]:
        """The nodes that a tree of format 4 may use, by ID, sorted."""
        return self.manifests_of(4)

    def get(self, id: str, format: int = 4) -> Manifest | None:
        """Return the manifest of a node.

        Args:
            id: The registration ID, which is the tag in the XML.
            format: The XML format of the tree, 3 or 4. The same ID may be another node in the other format.

        Returns:
            The manifest; None if the ID is unknown in this format.
        """
        node = self._nodes[format].get(id) or self._installed[format].get(id)
        if node is None or isinstance(node, Manifest):
            return node
        # mypy takes the hash of a node for that of the class.
        return _builtin_manifest(id, node)  # type: ignore[arg-type]

    def is_taken(self, id: str, format: int = 4) -> bool:
        """Return whether an ID belongs to a node, so that another node or a tree cannot have it.

        Both can have the ID of a node of an installed library, which they override.

        Args:
            id: The registration ID.
            format: The XML format, 3 or 4.
        """
        return id in self._nodes[format]

    @property
    def overridden_nodes(self) -> list[tuple[Manifest, Manifest]]:
        """Pairs of manifests: a node of an installed library, and the other node that has its ID."""
        pairs = {
            id: (theirs, mine)
            for format, nodes in self._installed.items()
            for id, theirs in nodes.items()
            if isinstance(theirs, Manifest)
            and (mine := self.get(id, format)) is not None
            and not theirs.has_same_origin(mine)
        }
        return list(pairs.values())

    @property
    def libraries(self) -> list[str]:
        """The libraries that registered nodes, in order: "btcore" and the plugins."""
        return list(self._libraries)

    def __contains__(self, id: object) -> bool:
        return isinstance(id, str) and self.get(id) is not None

    def __iter__(self) -> Iterator[Manifest]:
        return iter(self.manifests.values())

    # --- adding and removing

    def add(self, *implementations: Any, ID: str | None = None, format: int | None = None) -> None:
        """Register nodes: functions as leaves, and node classes.

        Args:
            implementations: The functions and classes.
            ID: The tag in the XML, for a single node. By default the ID given to the decorator, else the
                name of the class, or the name of the function in CamelCase.
            format: 3 or 4 = register for trees of this XML format only; None = for both formats. Format 3
                allows more port names.

        Raises:
            RegistrationError: A node cannot be registered, or its ID is registered already.
        """
        names = _names_of_caller()
        if ID is not None and len(implementations) != 1:
            raise RegistrationError(f"ID='{ID}' names one node, but {len(implementations)} are given")
        if format not in (None, 3, 4):
            raise RegistrationError(f"format={format!r} is not supported: use 3 or 4")
        for implementation in implementations:
            self._add(implementation, ID, names, library_of(implementation), format)

    def replace(self, **nodes: Any) -> None:
        """Register other implementations of registered nodes: `replace(Grasp=grasp_gently)`.

        Args:
            nodes: The new functions and classes, by ID.

        Raises:
            RegistrationError: An ID is not registered, or an implementation cannot be registered; the
                registry is then unchanged for this ID.
        """
        names = _names_of_caller()
        for id, implementation in nodes.items():
            library = library_of(implementation)
            manifest = create_manifest(_id_of(implementation, id), implementation, self.types, names, library)
            self.remove(id)
            self._put(manifest, (3, 4))

    def remove(self, id: str) -> None:
        """Unregister *id* for both formats.

        Raises:
            RegistrationError: *id* is not registered.
        """
        removed = [nodes.pop(id, None) for nodes in (*self._nodes.values(), *self._installed.values())]
        if not any(removed):
            hint = did_you_mean(id, self.manifests)
            raise RegistrationError(f"no node is registered as '{id}'{hint}")

    def add_type(
        self,
        python_type: type,
        from_text: Callable[[str], Any] | None = None,
        to_text: Callable[[Any], str] | None = None,
        name: str | None = None,
    ) -> None:
        """Register a class as a type that ports can have.

        Args:
            python_type: The class of the values.
            from_text: Converts the text in the XML to a value.
            to_text: Converts a value to a text.
            name: The name of the type in monitoring protocols and XML models; by default the class's name.

        Raises:
            RegistrationError: The class has a text form already, or another type has this name.
        """
        self.types.add(python_type, from_text, to_text, name)

    def add_enum(self, enum: type[Enum] | Mapping[str, int]) -> None:
        """Register an enum, whose names scripts and ports may then use.

        Args:
            enum: The class, or a mapping of names to numbers: `add_enum({"RED": 1})`.

        Raises:
            RegistrationError: A name is registered with another number, or a value is not an integer.
        """
        self.types.add_enum(enum)

    def add_trees(self, *sources: str | PathLike[str], confined: bool = False) -> None:
        """Register the trees of XML documents.

        `btcore.make` creates a registered tree. Every tree that is loaded with this registry can call
        the registered trees as subtrees. A tree replaces trees with the same ID that were registered before.

        Args:
            sources: XML texts, and paths of XML files. A string that contains `<` is a text.
            confined: Whether includes from outside of the folder of the given XML file are errors, for
                trees from strangers. The folder of a text is the working directory.

        Raises:
            TreeError: A file can't be read, or a document is not valid XML. No tree is registered then.
        """
        documents = [
            parse_text(source, confined=confined)
            if isinstance(source, str) and "<" in source
            else parse_file(source, confined=confined)
            for source in sources
        ]
        self.documents += documents

    # --- substitution

    def substitute(self, filter: str, by: Any) -> None:
        """Replace nodes in trees that are loaded from now on.

        A replaced node keeps its ID, name, ports and conditions. If a leaf replaces a node with children, the
        children are not created. If several rules match a node, the first rule applies. A rule with the
        filter of an earlier rule replaces that rule.

        Args:
            filter: A registration ID, an instance name, or a full path with the wildcards `*` and `?`.
            by: The ID of a registered node, a function, a node class, or a `TestNodeConfig` of
                btcore.testing.

        Raises:
            RegistrationError: The function or class cannot be used as a node.
        """
        offered = None if inspect.isclass(by) else getattr(by, "manifest", None)
        if callable(offered):
            by = offered()
        elif not isinstance(by, str):
            by = create_manifest(_id_of(by), by, self.types, _names_of_caller(), library_of(by))
        self.substitutions[filter] = SubstitutionRule(filter, by)

    def apply_substitutions(self, config: NodeConfig, manifest: Manifest, children: int) -> Manifest:
        """Return the manifest from which a node is created, after the substitution rules were applied.

        Args:
            config: The configuration of the node.
            manifest: The manifest of the node's ID.
            children: The number of children.

        Raises:
            NodeError: A rule names a node that is not registered, or cannot have this number of children.
        """
        rule = next((rule for rule in self.substitutions.values() if rule.matches(config)), None)
        if rule is None:
            return manifest
        by = rule.by if isinstance(rule.by, Manifest) else self.get(rule.by, config.format)
        replaces = f"the substitution rule '{rule.filter}' replaces <{config.id}>"
        if by is None:
            hint = did_you_mean(str(rule.by), self.manifests_of(config.format))
            raise NodeError(f"{replaces} by '{rule.by}', but no node is registered with this ID{hint}")
        if by.type in (NodeType.DECORATOR, NodeType.SUBTREE) and children != 1:
            needed = "exactly one child"
        elif by.type is NodeType.CONTROL and not children:
            needed = "children"
        else:
            return by
        has = f"<{config.id}> has {children or 'none'}"
        raise NodeError(f"{replaces} by <{by.id}>, which needs {needed}, but {has}")

    def _add(
        self,
        implementation: Any,
        id: str | None,
        names: Mapping[str, Any],
        library: str,
        format: int | None = None,
    ) -> None:
        id = _id_of(implementation, id)
        manifest = create_manifest(id, implementation, self.types, names, library, format or 4)
        formats = (3, 4) if format is None else (format,)
        known = next((self.get(id, used) for used in formats if self.is_taken(id, used)), None)
        if known is not None and known.has_same_origin(manifest):
            raise RegistrationError(
                f"'{id}' is registered already, from the same place: {known.origin}; add it once"
            )
        if known is not None:
            raise RegistrationError(
                f"'{id}' is registered twice: by {known.origin} and by {manifest.origin}; "
                f"replace the first with replace(…), or give one of them another ID"
            )
        self._put(manifest, formats)

    def _put(self, manifest: Manifest, formats: Iterable[int]) -> None:
        for format in formats:
            self._nodes[format][manifest.id] = manifest
        if manifest.library not in self._libraries:
            self._libraries.append(manifest.library)

    # --- node libraries

    def add_installed_libraries(
        self, *, own: bool = True, strict: bool = True
    ) -> list[UnavailableEntryPoint]:
        """Register the node libraries of all installed packages (entry points "btcore.nodes").

        Other nodes and types of the registry override them: a node that is registered by other means replaces
        the library's node with the same ID. A type that is registered by other means has its name also if the
        library has such a type; the ports of the library keep their type.

        Args:
            own: Whether to register the libraries of btcore's own packages, too.
            strict: Whether a library with a mistake raises its error; if not, it is returned.

        Returns:
            The libraries that were not registered, with their errors. A library that imports a module that is
            not installed, such as an optional dependency, is never a mistake.

        Raises:
            RegistrationError: A library cannot be registered, although no module is missing.
        """
        unavailable = []
        for point in entry_points.find(NODES_GROUP, own):
            try:
                self._library_layer().add_plugin(point.value, point.distribution)
            except RegistrationError as error:
                ignored = UnavailableEntryPoint(point.name, point.distribution, error)
                if strict and ignored.missing_module is None:
                    raise
                unavailable.append(ignored)
        return unavailable

    def add_plugin(self, plugin: "str | Path | ModuleType | Plugin", name: str | None = None) -> None:
        """Register a plugin: a node library that the program names.

        If the module has a function `register(nodes)`, or `module:function` names another function,
        this function is called to register the nodes. Otherwise the node classes and the functions marked
        with `@action` or `@condition` that the module defines are registered.

        Args:
            plugin: A module, its name, `module:function`, the path of a Python file, or a `Plugin`.
            name: The name of the library; by default the module's name.

        Raises:
            RegistrationError: The plugin cannot be imported or registered; the message names the line.
        """
        if isinstance(plugin, ModuleType):
            plugin = Plugin(plugin)
        module, function = plugin if isinstance(plugin, Plugin) else import_plugin(plugin, name)
        name = name or module.__name__.removeprefix(PLUGIN_FILE_PREFIX)
        register = getattr(module, function, None)
        if function != "register" and not callable(register):
            raise RegistrationError(f"plugin '{name}': {module.__name__} has no function '{function}'")
        try:
            if callable(register):
                register(self)
            else:
                leaves = list(_leaves_in(module))
                if not leaves:
                    raise RegistrationError(
                        "it has no nodes: no function register(nodes), no node class of its own, and no "
                        "function marked as @action or @condition"
                    )
                for implementation in leaves:
                    self._add(implementation, None, vars(module), name)
        except RegistrationError as error:
            raise RegistrationError(f"plugin '{name}': {error}") from error
        except Exception as error:
            from btcore.registry.plugin_modules import plugin_error

            raise plugin_error(f"'{name}'", error, f"its {function}() was called") from error
        if name not in self._libraries:
            self._libraries.append(name)


class Plugin(NamedTuple):
    """The *module* of a node library, and the name of its *function* that registers the nodes."""

    module: ModuleType
    function: str = "register"

    @property
    def has_nodes(self) -> bool:
        """Whether the module has the function or defines nodes; a user's file may have providers alone."""
        has_function = callable(getattr(self.module, self.function, None))
        return has_function or next(iter(_leaves_in(self.module)), None) is not None


def import_plugin(plugin: str | Path, name: str | None = None) -> Plugin:
    """Import a plugin without registering it; the arguments are those of `Registry.add_plugin`."""
    function = "register"
    if isinstance(plugin, str) and not plugin.strip():
        raise RegistrationError("a plugin has no name: give the name of a module, or the path of a file")
    if isinstance(plugin, str) and not plugin.endswith(".py") and ":" in plugin:
        plugin, function = plugin.split(":", 1)
    from btcore.registry.plugin_modules import import_module_or_file  # not for runs without plugins

    return Plugin(import_module_or_file(str(plugin), name), function)


def _id_of(implementation: Any, id: str | None = None) -> str:
    """Return the registration ID of a function or node class, by default that of its decorator or name."""
    if inspect.isclass(implementation):
        if not issubclass(implementation, TreeNode):
            raise RegistrationError(
                f"{implementation.__qualname__} is not a node: derive it from StatefulAction, "
                "SyncAction, Condition, ControlNode or DecoratorNode"
            )
        id = id or implementation.__name__
    elif isinstance(implementation, TreeNode):
        name = type(implementation).__name__
        raise RegistrationError(
            f"an object of the class {name} is given: register the class, nodes.add({name}); a tree "
            "creates an object for each of its nodes"
        )
    elif callable(implementation):
        mark = getattr(implementation, MARK, None)
        id = id or (mark.id if mark else None) or camel_case(getattr(implementation, "__name__", ""))
    else:
        hint = ": nodes.add(first, second)" if isinstance(implementation, (list, tuple, set)) else ""
        raise RegistrationError(f"{implementation!r} is neither a function nor a node class{hint}")
    return id


def _leaves_in(module: ModuleType) -> Iterable[Any]:
    for implementation in list(vars(module).values()):
        if getattr(implementation, "__module__", None) != module.__name__:
            continue
        if inspect.isclass(implementation):
            if (
                issubclass(implementation, TreeNode)
                and not inspect.isabstract(implementation)
                and not implementation.__name__.startswith("_")
            ):
                yield implementation
        elif hasattr(implementation, MARK):
            yield implementation


def library_of(implementation: Any) -> str:
    """Return the name of the library or program that defines the class or function *implementation*."""
    module = getattr(implementation, "__module__", None) or "?"
    return module.removeprefix(PLUGIN_FILE_PREFIX).partition(".")[0]


def _names_of_caller() -> dict[str, Any]:
    """Return the local names of the registry method's caller, to resolve annotations that are strings."""
    frame = inspect.currentframe()
    # Two frames up: the method of the registry, then its caller.
    for _ in range(2):
        frame = frame.f_back if frame is not None else None
    return dict(frame.f_locals) if frame is not None else {}
