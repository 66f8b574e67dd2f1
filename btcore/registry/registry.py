"""What tags a tree may use: built-in nodes, your own, and those of node libraries."""

import importlib
import inspect
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import Enum
from pathlib import Path
from types import ModuleType
from typing import Any

from btcore.engine.functions import MARK, camel_case
from btcore.engine.node import TreeNode
from btcore.engine.node_config import NodeConfig
from btcore.errors import RegistrationError
from btcore.nodes.builtin_nodes import BUILTIN_NODES
from btcore.registry.manifest import Manifest, class_manifest, function_manifest
from btcore.registry.substitution import SubstitutionRule, first_matching_rule
from btcore.suggestions import nearest_name
from btcore.values import TypeRegistry

ENTRY_POINTS = "btcore.nodes"
_OF_FILE = "btcore_plugin_"


class Registry:
    """The nodes, types and enums that trees are made with.

    A registry is a value: make one for each use, and hand it to :func:`btcore.load`.
    """

    def __init__(self) -> None:
        self.types = TypeRegistry()
        # A built-in node that nothing has used yet is kept as its class: making its manifest takes time.
        self._shared: dict[str, Manifest | type[TreeNode]] = {}
        self._of_format: dict[int, dict[str, Manifest | type[TreeNode]]] = {3: {}, 4: {}}
        self._libraries: list[str] = []
        self.substitutions: dict[str, SubstitutionRule] = {}
        self.overridden_nodes: list[tuple[Manifest, Manifest]] = []
        """Nodes of installed libraries that gave way, each with what took its place."""
        self._installing = False

    @classmethod
    def standard(cls) -> "Registry":
        """A registry of everything that BehaviorTree.CPP 4.10 has built in, and 3.8 for format 3."""
        made = cls()
        for format, nodes in BUILTIN_NODES.items():
            for ID, node in nodes.items():
                common = BUILTIN_NODES[7 - format].get(ID) is node
                table = made._shared if common else made._of_format[format]
                table[ID] = node
        made._libraries.append("btcore")
        return made

    def copy(self) -> "Registry":
        """Another registry of the same nodes and rules; types and enums are shared."""
        made = Registry()
        made.types = self.types
        made._shared = dict(self._shared)
        made._of_format = {format: dict(table) for format, table in self._of_format.items()}
        made._libraries = list(self._libraries)
        made.substitutions = dict(self.substitutions)
        return made

    # --- looking up

    def manifests_of(self, format: int = 4) -> Mapping[str, Manifest]:
        """Every node that a tree of *format* (3 or 4) may use, by ID, sorted."""
        ids = sorted({*self._shared, *self._of_format[format]})
        return {ID: manifest for ID in ids if (manifest := self.get(ID, format)) is not None}

    @property
    def manifests(self) -> Mapping[str, Manifest]:
        """Every node that a tree of format 4 may use, by ID, sorted."""
        return self.manifests_of(4)

    def get(self, ID: str, format: int = 4) -> Manifest | None:
        """The node *ID* as a tree of *format* knows it."""
        for table in (self._of_format[format], self._shared):
            entry = table.get(ID)
            if isinstance(entry, Manifest):
                return entry
            if entry is not None:
                made = table[ID] = class_manifest(ID, entry, self.types, {}, "btcore")
                return made
        return None

    @property
    def libraries(self) -> list[str]:
        """Who brought nodes, in order: "btcore" and the plugins."""
        return list(self._libraries)

    def __contains__(self, ID: object) -> bool:
        return isinstance(ID, str) and self.get(ID) is not None

    def __iter__(self) -> Iterator[Manifest]:
        return iter(self.manifests.values())

    # --- adding and removing

    def add(self, *things: Any, ID: str | None = None, format: int | None = None) -> None:
        """Register leaves, control nodes and decorators: functions, or classes.

        The tag is *ID*, else the one given to the decorator, else the class's name or the function's
        in CamelCase. With *format* (3 or 4) trees of that format alone know it; the ports of format 3
        may have names that format 4 doesn't take. Raises RegistrationError, for an ID that is taken too.
        """
        names = _names_of_caller()
        if ID is not None and len(things) != 1:
            raise RegistrationError(f"ID='{ID}' names one thing, but {len(things)} are given")
        if format not in (None, 3, 4):
            raise RegistrationError(f"there are the formats 3 and 4, but format={format!r} is given")
        for thing in things:
            self._add(thing, ID, names, _distribution_of(thing), format)

    def replace(self, **nodes: Any) -> None:
        """Register ``ID=thing`` in place of what is registered as *ID* now."""
        names = _names_of_caller()
        for ID, thing in nodes.items():
            tables = [table for table in (self._shared, *self._of_format.values()) if ID in table]
            before = [table[ID] for table in tables]
            self.remove(ID)
            try:
                self._add(thing, ID, names, _distribution_of(thing))
            except RegistrationError:
                for table, manifest in zip(tables, before, strict=True):
                    table[ID] = manifest
                raise

    def remove(self, ID: str) -> None:
        """Unregister *ID* from both formats. Raises RegistrationError if there is none."""
        found = [table.pop(ID, None) for table in (self._shared, *self._of_format.values())]
        if not any(found):
            guess = nearest_name(ID, self.manifests)
            hint = f"; did you mean '{guess}'?" if guess else ""
            raise RegistrationError(f"no node is registered as '{ID}'{hint}")

    def add_type(self, python_type: type, from_text: Callable[[str], Any] | None = None, **more: Any) -> None:
        """Let ports be of *python_type*; *from_text* makes one from what the XML says."""
        self.types.add(python_type, from_text, **more)

    def add_enum(self, enum: type[Enum] | Mapping[str, int]) -> None:
        """Let scripts and ports use the names of *enum*."""
        self.types.add_enum(enum)

    # --- substitution

    def substitute(self, filter: str, by: Any) -> None:
        """Let trees made from now on have *by* in the place of every node that *filter* meets.

        *filter* is a registration ID, an instance name, or a full path with ``*`` and ``?``. *by* is the
        ID of a registered node, a function or a node class, or a ``TestNodeConfig`` of btcore.testing.
        The node keeps its ID, name, ports and conditions; what was below a node that a leaf replaces is
        not made. Of several rules the first applies; a filter given again gets another rule in its place.
        """
        offered = None if inspect.isclass(by) else getattr(by, "manifest", None)
        if callable(offered):
            by = offered()
        elif not isinstance(by, str):
            by = self._manifest_of(by, None, _names_of_caller(), _distribution_of(by))
        self.substitutions[filter] = SubstitutionRule(filter, by)

    def apply_substitutions(self, config: NodeConfig, manifest: Manifest, children: int) -> Manifest:
        """What makes the node of *config*: *manifest*, or another by the substitution rules.

        Raises NodeError where a rule names a node that isn't registered, or wants other *children*.
        """
        rule = first_matching_rule(self.substitutions, config)
        return (
            manifest
            if rule is None
            else rule.replacement_manifest(config, children, self.manifests_of(config.format))
        )

    def _add(
        self,
        thing: Any,
        ID: str | None,
        names: Mapping[str, Any],
        distribution: str,
        only: int | None = None,
    ) -> None:
        manifest = self._manifest_of(thing, ID, names, distribution, only or 4)
        for format in (3, 4) if only is None else (only,):
            known = self.get(manifest.id, format)
            if known is not None and known.is_overridable and not self._installing:
                if known.same_thing(manifest):
                    return
                self.remove(manifest.id)
                self.overridden_nodes.append((known, manifest))
                known = None
            if known is not None and known.same_thing(manifest):
                raise RegistrationError(
                    f"'{manifest.id}' is registered already, from the same place: {known.origin}; add it once"
                )
            if known is not None:
                raise RegistrationError(
                    f"'{manifest.id}' is registered twice: by {known.origin} and by {manifest.origin}; "
                    f"replace(…) it deliberately, or give one of them another ID"
                )
        manifest.is_overridable = self._installing
        table = self._shared if only is None else self._of_format[only]
        table[manifest.id] = manifest
        if distribution not in self._libraries:
            self._libraries.append(distribution)

    def _manifest_of(
        self, thing: Any, ID: str | None, names: Mapping[str, Any], distribution: str, format: int = 4
    ) -> Manifest:
        if inspect.isclass(thing):
            if not issubclass(thing, TreeNode):
                raise RegistrationError(
                    f"{thing.__qualname__} is no node: derive it from StatefulAction, SyncAction, Condition, "
                    "ControlNode or DecoratorNode"
                )
            return class_manifest(ID or thing.__name__, thing, self.types, names, distribution, format)
        if callable(thing):
            mark = getattr(thing, MARK, None)
            tag = ID or (mark.ID if mark else None) or camel_case(getattr(thing, "__name__", ""))
            return function_manifest(tag, thing, self.types, names, distribution, format)
        hint = ": nodes.add(first, second)" if isinstance(thing, (list, tuple, set)) else ""
        raise RegistrationError(f"{thing!r} is neither a function nor a node class{hint}")

    # --- node libraries

    def add_plugins(self) -> list[RegistrationError]:
        """Register the node libraries of all installed packages (entry points "btcore.nodes").

        One that needs a module which isn't installed (an extra, say) is left out, and told of in the
        result. Raises RegistrationError for any other fault.
        """
        # It takes longer to import than the rest of the engine, and most programs do without.
        from importlib.metadata import entry_points

        left_out = []
        for point in sorted(entry_points(group=ENTRY_POINTS), key=lambda one: one.name):
            try:
                self.add_installed(point.value, point.dist.name if point.dist else point.name)
            except RegistrationError as fault:
                if not isinstance(fault.__cause__, ModuleNotFoundError):
                    raise
                left_out.append(fault)
        return left_out

    def add_installed(self, library: str, name: str) -> None:
        """Register a library that comes with the installed package *name*, as :meth:`add_plugin` does.

        Its nodes give way to those that are registered under the same IDs later on.
        """
        self._installing = True
        try:
            self.add_plugin(library, name)
        finally:
            self._installing = False

    def add_plugin(self, library: str | Path | ModuleType, name: str | None = None) -> None:
        """Register a node library: a module, its name, or the path of its file.

        A library with a function ``register(nodes)``, or the one that ``module:function`` names, is asked
        to register its nodes; of any other the node classes and the functions marked as leaves that it
        defines are taken. *name* is who brings it, by default the module's name. Raises
        RegistrationError, which names the library and the line, also when importing it raises.
        """
        asked = "register"
        if isinstance(library, str) and not library.strip():
            raise RegistrationError("a plugin has no name: give that of a module, or the path of a file")
        if isinstance(library, str) and not library.endswith(".py") and ":" in library:
            library, asked = library.split(":", 1)
        module = library if isinstance(library, ModuleType) else _import(str(library), name)
        called = name or module.__name__.removeprefix(_OF_FILE)
        register = getattr(module, asked, None)
        if asked != "register" and not callable(register):
            raise RegistrationError(f"plugin '{called}': {module.__name__} has no function '{asked}'")
        try:
            if callable(register):
                register(self)
            else:
                leaves = list(_leaves_in(module))
                if not leaves:
                    raise RegistrationError(
                        "it brings no nodes: it has no register(nodes), no node class of its own, and no "
                        "function marked as @action or @condition"
                    )
                for thing in leaves:
                    self._add(thing, None, vars(module), called)
        except RegistrationError as fault:
            raise RegistrationError(f"plugin '{called}': {fault}") from fault
        except Exception as fault:
            raise _broken(called, fault, f"its {asked}() was called") from fault
        if called not in self._libraries:
            self._libraries.append(called)


def _leaves_in(module: ModuleType) -> Iterable[Any]:
    for thing in list(vars(module).values()):
        if getattr(thing, "__module__", None) != module.__name__:
            continue
        if inspect.isclass(thing):
            if (
                issubclass(thing, TreeNode)
                and not inspect.isabstract(thing)
                and not thing.__name__.startswith("_")
            ):
                yield thing
        elif hasattr(thing, MARK):
            yield thing


def _import(library: str, name: str | None) -> ModuleType:
    called = library if name in (None, library) else f"{library}' of '{name}"
    try:
        if library.endswith(".py") or "/" in library:
            return _import_file(Path(library))
        return importlib.import_module(library)
    except RegistrationError:
        raise
    except ModuleNotFoundError as fault:
        if fault.name is not None and (library == fault.name or library.startswith(fault.name + ".")):
            raise RegistrationError(
                f"plugin '{called}' is not found: give the name of a module that can be imported, "
                "or a file ending in .py"
            ) from fault
        raise _broken(called, fault) from fault
    except (Exception, SystemExit) as fault:
        raise _broken(called, fault) from fault


def _import_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise RegistrationError(f"plugin '{path}' is not found: there is no such file")
    from importlib.util import module_from_spec, spec_from_file_location

    name = f"{_OF_FILE}{path.stem}"
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise RegistrationError(f"plugin '{path}' is no Python file")
    module = module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _broken(library: str, fault: BaseException, doing: str = "it was imported") -> RegistrationError:
    if isinstance(fault, SyntaxError):
        where = f"{fault.filename}:{fault.lineno}"
    else:
        import traceback

        last = traceback.extract_tb(fault.__traceback__)[-1]
        where = f"{last.filename}:{last.lineno}"
    return RegistrationError(
        f"plugin '{library}' raised while {doing}: {where}: {type(fault).__name__}: {fault}"
    )


def _distribution_of(thing: Any) -> str:
    module = getattr(thing, "__module__", None) or "?"
    return module.partition(".")[0] if module != "__main__" else "__main__"


def _names_of_caller() -> dict[str, Any]:
    """The local names around the call of the registry's method, for annotations that are texts."""
    frame = inspect.currentframe()
    for _ in range(2):
        frame = frame.f_back if frame is not None else None
    return dict(frame.f_locals) if frame is not None else {}
