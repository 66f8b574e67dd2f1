"""Build a tree from documents: check and plan them, then create the nodes."""

import gc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import cast

from mypy_extensions import mypyc_attr

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.blackboard.format3 import LegacyBlackboard
from btcore.blackboard.ports import Binding, Input, Output, Port
from btcore.clock import Clock, SystemClock
from btcore.diagnostic_codes import (
    CONFLICTING_ENTRY_TYPES,
    DUPLICATE_SUBTREE_PATH,
    INCONVERTIBLE_TEXT,
    LEAF_INIT_RAISED,
    MISSING_PORT,
    NODE_NOT_CREATED,
    SCRIPT_SYNTAX,
    DiagnosticCode,
)
from btcore.engine.context import TreeContext
from btcore.engine.node import TreeNode
from btcore.engine.node_config import NodeConfig
from btcore.errors import BlackboardError, BtcoreError, ConversionError, Diagnostic, NodeError, ScriptError
from btcore.registry.manifest import Manifest, Resources, takes_children
from btcore.registry.registry import Registry, library_of
from btcore.tree.tree import Subtree, Tree
from btcore.values import parse_constant, type_of
from btcore.xml.plan.document_checks import DocumentAnalysis, analyse_document, script_diagnostic
from btcore.xml.plan.plan import NodePlan, SubtreeCall, TreePlan
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.document import Document
from btcore.xml.read.includes import PackageResolver


@contextmanager
def pause_gc(keeps: bool = True) -> Iterator[None]:
    """Disable Python's cyclic garbage collector while a tree is loaded or checked.

    The collector would scan the growing tree again and again, although no part of it is garbage.

    Args:
        keeps: Whether the new objects are kept afterwards. False if nearly all of them are freed.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    # A new tree goes to the oldest generation at once: scanning it on its way there takes a fifth of the
    # time of loading. Only freeze() moves objects there, and it moves all young objects of the process;
    # therefore the other young objects are collected first. An application's frozen objects stay frozen.
    moves = keeps and was_enabled and not gc.get_freeze_count()
    if moves:
        gc.collect(1)
    try:
        yield
    finally:
        if moves:
            gc.freeze()
            gc.unfreeze()
        if was_enabled:
            gc.enable()


@pause_gc()
def build(
    document: Document,
    registry: Registry,
    tree: str | None = None,
    format: int | None = None,
    blackboard: Blackboard | None = None,
    resources: Sequence[object] = (),
    clock: Clock | None = None,
    packages: PackageResolver | None = None,
    libraries: Sequence[Document] = (),
    tick_limit: float | None = None,
) -> Tree:
    """Build the tree of a document.

    Args:
        document: The parsed document.
        registry: The registered nodes.
        tree: ID of the tree to build; by default the document's main tree.
        format: 3 or 4, overriding the document's `BTCPP_format`.
        blackboard: The blackboard of the main tree; by default a new blackboard.
        resources: Objects that leaves require, selected by their types.
        clock: The clock; by default the first clock in *resources*, or else the system clock.
        packages: Finds the share directory of a ROS package.
        libraries: Further documents, whose trees *document* may call without an include.
        tick_limit: See `Tree`.

    Raises:
        TreeError: The document has errors; the exception contains all of them.
    """
    analysis = analyse_document(document, registry, tree, format, packages, libraries)
    analysis.diagnostics.raise_errors()
    return TreeInstantiator(analysis, registry, blackboard, resources, clock, tick_limit).instantiate()


@mypyc_attr(allow_interpreted_subclasses=True)
class TreeInstantiator:
    """Creates the nodes of one tree, depth-first, and collects the errors.

    Attributes:
        format: The format of the tree, 3 or 4.
        blackboard: The main tree's blackboard.
        subtrees: The subtrees with their blackboards, the main tree first.
    """

    def __init__(
        self,
        analysis: DocumentAnalysis,
        registry: Registry,
        blackboard: Blackboard | None,
        resources: Sequence[object],
        clock: Clock | None,
        tick_limit: float | None = None,
    ) -> None:
        self._tick_limit = tick_limit
        if clock is None:
            clock = _clock_among(resources)
        assert analysis.main is not None
        self._main = analysis.main
        self._planner = analysis.planner
        self.format = analysis.planner.dialect.format
        self._registry = registry
        # Most registries have no substitution rules; then the manifests of the plan are used as they are.
        self._rules = registry.substitutions
        self._enums = registry.types.enums
        self._resources = Resources(resources)
        self._context = TreeContext(clock)
        self._scopes = Blackboard if self.format == 4 else LegacyBlackboard
        self.blackboard = blackboard if blackboard is not None else self._scopes(clock=clock)
        self.subtrees: list[Subtree] = []
        self._nodes: list[TreeNode] = []
        # The main tree's path is the empty text, as in BehaviorTree.CPP.
        self._paths: set[str] = {""}
        self._declared: dict[Entry, tuple[Binding, NodeConfig]] = {}
        self._uid = 0
        self._diagnostics = DiagnosticCollector()

    def instantiate(self) -> Tree:
        """Create the nodes, and return the tree.

        Raises:
            TreeError: Nodes could not be created; the exception contains all errors.
        """
        self._instance(self._planner.plan(self._main), "", self.blackboard)
        self._diagnostics.raise_errors()
        return Tree(
            self._main.id,
            self.format,
            self.subtrees,
            self._nodes,
            self._context,
            self._registry,
            self._tick_limit,
        )

    def _instance(self, plan: TreePlan, path: str, blackboard: Blackboard) -> TreeNode | None:
        """Create an instance of a tree definition. Return its root, or None if it could not be created."""
        subtree = Subtree(plan.definition.id, path, blackboard)
        self.subtrees.append(subtree)
        assert plan.root is not None
        return self._node(plan.root, plan, subtree, f"{path}/" if path else "")

    def _node(self, plan: NodePlan, tree: TreePlan, subtree: Subtree, prefix: str) -> TreeNode | None:
        document = tree.definition.document
        line = plan.element.line if document.knows_lines else document.line(plan.element)
        self._uid = uid = self._uid + 1
        id = plan.id
        name = id if plan.name is None else plan.name
        config = NodeConfig(
            id, name, uid, self.format, document.file, line, plan.scripts, plan.attributes, self._enums
        )
        if plan.call is not None:
            return self._subtree(plan, plan.call, config, tree, subtree, prefix)
        if name == id:
            # BehaviorTree.CPP appends the uid to the path of a node without a name.
            config.path = f"{prefix}{name}::{uid}"
        elif prefix:
            config.path = prefix + name
        blackboard = subtree.blackboard
        self._ports(plan, config, document, blackboard)
        manifest = self._substituted(plan, config, document) if self._rules else plan.manifest
        if not plan.children:
            leaf = self._make(plan, manifest, config, document, blackboard, ())
            if leaf is not None:
                self._nodes.append(leaf)
                subtree.nodes.append(leaf)
            return leaf
        # Nodes are listed in pre-order, but a parent is created after its children: keep its place.
        at, own_at = len(self._nodes), len(subtree.nodes)
        self._nodes.append(_PLACE_HOLDER)
        subtree.nodes.append(_PLACE_HOLDER)
        below = plan.children if not self._rules or takes_children(manifest) else ()
        children = [self._node(child, tree, subtree, prefix) for child in below]
        node = self._make(plan, manifest, config, document, blackboard, children)
        if node is not None:
            self._nodes[at] = subtree.nodes[own_at] = node
        return node

    def _ports(self, plan: NodePlan, config: NodeConfig, document: Document, blackboard: Blackboard) -> None:
        """Bind the ports, and declare the entries that the ports point to."""
        if not plan.bindings:
            return
        inputs: dict[str, Input] = {}
        outputs: dict[str, Output] = {}
        for bound in plan.bindings:
            port = bound.port
            key = bound.key
            if key is not None and bound.is_explicit:
                try:
                    entry = blackboard.create(key, port.type, not port.writes)
                except (BlackboardError, ConversionError) as error:
                    self._diagnostics.add(self._clash(document, plan, port, blackboard.find(key), error))
                else:
                    # The first port with a type declares the type; later ports are compared with it.
                    if entry not in self._declared and port.type.strong:
                        self._declared[entry] = (bound, config)
            if isinstance(bound, Input):
                inputs[port.name] = bound if bound.blackboard is blackboard else bound.bind_to(blackboard)
            # In format 3 the default of an output port is not connected.
            if port.writes and (bound.is_explicit or (key is not None and bound.format == 4)):
                outputs[port.name] = Output(bound, blackboard)
        config.inputs = inputs
        if outputs:
            config.outputs = outputs

    def declared_by(self, entry: Entry) -> str:
        """Return the port that declared the type of *entry*, with its place, or ""."""
        if entry not in self._declared:
            return ""
        bound, config = self._declared[entry]
        return f"'{bound.port.name}' of <{config.id}> ({config.where})"

    def _clash(
        self, document: Document, plan: NodePlan, port: Port, entry: Entry | None, error: BtcoreError
    ) -> Diagnostic:
        """Return the diagnostic for a port whose type differs from the declared type of its entry."""
        if entry is None or entry.declared.same(port.type):
            return document.diagnostic(CONFLICTING_ENTRY_TYPES, str(error), plan.element, port.name)
        own, declared = port.type.name, entry.declared.name
        if own == declared:
            own += f" of {library_of(port.type.python_type)}"
            declared += f" of {library_of(entry.declared.python_type)}"
        types = f"has the type {own}, but its entry has the type {declared}"
        message = f"the port '{port.name}' of <{plan.id}> {types}"
        first = self.declared_by(entry)
        origin = f"declared by {first}" if first else "it was on the blackboard before the tree was built"
        hint = f"{origin}; the type of an entry never changes"
        if self.format == 4 and entry.declared.is_related(port.type):
            hint = (
                f"{origin}; an output needs exactly this type, so declare the port as {entry.declared.name}"
            )
        return document.diagnostic(CONFLICTING_ENTRY_TYPES, message, plan.element, port.name, hint=hint)

    def _make(
        self,
        plan: NodePlan,
        manifest: Manifest | None,
        config: NodeConfig,
        document: Document,
        blackboard: Blackboard,
        children: Sequence[TreeNode | None],
    ) -> TreeNode | None:
        created: list[TreeNode] = []
        if children:
            created += [child for child in children if child is not None]
            if len(created) != len(children):
                return None  # the error of the child is in the diagnostics
        if manifest is None:
            return None
        try:
            return manifest.make(config, self._context, blackboard, self._resources, created)
        except ScriptError as error:
            self._diagnostics.add(self._script_diagnostic(document, plan, error))
        except (NodeError, BlackboardError, ConversionError) as error:
            self._diagnostics.add(document.diagnostic(_code_of(error, plan), str(error), plan.element))
        except BtcoreError:
            raise  # an error of the program, not of the document
        except Exception as error:
            message = f"<{plan.id}> raised while it was created: {type(error).__name__}: {error}"
            hint = ""
            if isinstance(error, TypeError) and str(error).startswith("object.__init__()"):
                hint = "call super().__init__() without arguments: a node has its name and config already"
            self._diagnostics.add(document.diagnostic(LEAF_INIT_RAISED, message, plan.element, hint=hint))
        return None

    def _substituted(self, plan: NodePlan, config: NodeConfig, document: Document) -> Manifest | None:
        """Return the manifest after the registry's substitution rules, or None after an error."""
        if plan.manifest is None:
            return None
        # A SubTree node has the root of the called tree as its only child.
        children = len(plan.children) if plan.call is None else 1
        try:
            return self._registry.apply_substitutions(config, plan.manifest, children)
        except NodeError as error:
            self._diagnostics.add(document.diagnostic(NODE_NOT_CREATED, str(error), plan.element))
            return None

    def _script_diagnostic(self, document: Document, plan: NodePlan, error: ScriptError) -> Diagnostic:
        texts = {key: text for key, text in plan.element.attributes.items() if text == error.text}
        if texts:
            return script_diagnostic(document, plan, next(iter(texts)), error)
        return document.diagnostic(SCRIPT_SYNTAX, f"a script of <{plan.id}>: {error}", plan.element)

    # --- SubTree elements

    def _subtree(
        self,
        plan: NodePlan,
        call: SubtreeCall,
        config: NodeConfig,
        tree: TreePlan,
        subtree: Subtree,
        prefix: str,
    ) -> TreeNode | None:
        document = tree.definition.document
        config.name = plan.name if plan.name is not None else call.tree
        # Format 3 ignores the name of a SubTree node in paths.
        own_name = plan.name if self.format == 4 else None
        config.path = prefix + (own_name if own_name is not None else f"{call.tree}::{config.uid}")
        config.attributes = {**call.written, **plan.attributes}
        if config.path in self._paths:
            message = f"two SubTree nodes have the path '{config.path}'"
            hint = "give them different names, or remove the names"
            self._diagnostics.add(
                document.diagnostic(DUPLICATE_SUBTREE_PATH, message, plan.element, "name", hint=hint)
            )
        self._paths.add(config.path)
        at, own_at = len(self._nodes), len(subtree.nodes)
        self._nodes.append(_PLACE_HOLDER)
        subtree.nodes.append(_PLACE_HOLDER)
        manifest = self._substituted(plan, config, document) if self._rules else plan.manifest
        children = []
        if takes_children(manifest):
            inner = self._scope(plan, call, document, subtree.blackboard)
            content = self._planner.plan(self._planner.definitions.by_id[call.tree])
            children.append(self._instance(content, config.path, inner))
        node = self._make(plan, manifest, config, document, subtree.blackboard, children)
        if node is not None:
            self._nodes[at] = subtree.nodes[own_at] = node
        return node

    def _scope(self, plan: NodePlan, call: SubtreeCall, document: Document, outer: Blackboard) -> Blackboard:
        """Return the blackboard of the inner tree, connected with *outer*."""
        if call.shared:
            return outer
        inner = self._scopes(outer)
        for key, outer_key in call.remaps.items():
            inner.remap(key, outer_key)
        for key, text in call.constants.items():
            inner.autoremap = key in call.outer_constants
            value = parse_constant(text) if self.format == 4 else text
            try:
                inner.set(key, value, None if isinstance(value, str) else type_of(value))
            except BlackboardError as error:
                self._diagnostics.add(
                    document.diagnostic(CONFLICTING_ENTRY_TYPES, str(error), plan.element, key)
                )
        inner.autoremap = call.autoremap
        return inner


def _code_of(error: Exception, plan: NodePlan) -> DiagnosticCode:
    if not isinstance(error, NodeError):
        return INCONVERTIBLE_TEXT
    given = {port.name for port, _, _ in plan.ports}
    ports = plan.manifest.ports.values() if plan.manifest is not None else ()
    # If a node can't be created and lacks an input port, the message names the port.
    missing = any(port.reads and port.name not in given for port in ports)
    return MISSING_PORT if missing else NODE_NOT_CREATED


def _clock_among(resources: Sequence[object]) -> Clock:
    """Return the first clock in *resources*, or else the system clock."""
    for resource in resources:
        if hasattr(resource, "now") and hasattr(resource, "wait_until"):
            return cast(Clock, resource)
    return SystemClock()


_PLACE_HOLDER = TreeNode()
