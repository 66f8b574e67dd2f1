"""Create a tree from its plans, and connect the ports of its nodes with the blackboards.

This is the fourth and last stage of loading.
"""

import reprlib
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Final

from mypy_extensions import mypyc_attr

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.blackboard.ports import LOAD_TIME_ROLES, Binding, Input, Output, Port, PortRole
from btcore.clock import Clock, SystemClock, is_clock
from btcore.diagnostic_codes import (
    CONFLICTING_ENTRY_TYPES,
    DUPLICATE_SUBTREE_PATH,
    INCONVERTIBLE_TEXT,
    LEAF_INIT_RAISED,
    MISSING_PORT,
    NODE_NOT_CREATED,
    SCRIPT_SYNTAX,
)
from btcore.engine.context import TreeContext
from btcore.engine.node import TreeNode
from btcore.engine.node_config import NodeConfig
from btcore.errors import BlackboardError, BtcoreError, ConversionError, NodeError, ScriptError
from btcore.fixes import SetAttributes
from btcore.registry.manifest import Manifest, takes_children
from btcore.registry.registry import library_of
from btcore.registry.resources import Resources
from btcore.tree.tree import Subtree, Tree, TreeDocument
from btcore.values import parse_constant, type_of
from btcore.xml.plan.plan import Plans, paused_garbage_collection, report_invalid_scripts
from btcore.xml.plan.tree_plan import NodePlan, SubtreeCall, TreePlan
from btcore.xml.read.document import DiagnosticCollector

_SCRIPT_EXAMPLES: Final = {PortRole.SCRIPT: "", PortRole.CONDITION: "true"}
"""The texts with which fixes add a missing port with a script."""
_PLACEHOLDER: Final = TreeNode()
"""Stands for a parent until its children are created, and for a node that could not be created."""


def instantiate(
    plans: Plans,
    resources: Sequence[object] = (),
    blackboard: Blackboard | None = None,
    clock: Clock | None = None,
    tick_limit: float | None = None,
) -> Tree:
    """Create the nodes of the main tree of *plans*, and return the tree.

    `btcore.load` describes the other parameters.

    Raises:
        TreeError: The plans have errors, or nodes could not be created. It holds all errors.
        TypeError: *resources* is not a list.
    """
    resources = resources_as_sequence(resources)
    plans.diagnostics.raise_errors()
    main = plans.main_tree
    assert main is not None, "a missing main tree is an error"
    creator = NodeCreator(plans, resources, clock or _find_clock(resources), blackboard)
    with paused_garbage_collection():
        creator.create_nodes(main)
    creator.collector.diagnostics.raise_errors()
    sources = plans.definitions.sources
    return Tree(
        main.id,
        creator.format,
        [draft.subtree for draft in creator.drafts],
        creator.nodes,
        creator.context,
        plans.registry,
        tick_limit,
        [TreeDocument(each.file, each.text, each in sources.shared_documents) for each in sources.documents],
    )


def resources_as_sequence(resources: object) -> Sequence[object]:
    """Return the *resources* of a program as a sequence.

    Raises:
        TypeError: They are not a list.
    """
    # A text can be iterated, but is a single object here.
    if isinstance(resources, (str, bytes)) or not isinstance(resources, Iterable):
        raise TypeError(f"resources={reprlib.repr(resources)} is not a list: write resources=[…]")
    return resources if isinstance(resources, Sequence) else list(resources)


def _find_clock(resources: Sequence[object]) -> Clock:
    """Return the first of *resources* that is a clock, or else the system clock.

    An attribute `clock` of a resource is not used: in an arbitrary object it may be anything. `btcore.Run`
    uses it only for the provider that declares a clock.
    """
    return next((resource for resource in resources if is_clock(resource)), None) or SystemClock()


class SubtreeDraft:
    """A `btcore.Subtree` while its nodes are created, with what only their creation needs.

    Attributes:
        subtree: The subtree, with the nodes so far.
        plan: The plan of its tree.
        document: The document of its tree.
        prefix: The beginning of the paths of its nodes.
        report: `DiagnosticCollector.report` for elements of the document.
    """

    __slots__ = ("document", "plan", "prefix", "report", "subtree")

    def __init__(
        self, plan: TreePlan, path: str, blackboard: Blackboard, collector: DiagnosticCollector
    ) -> None:
        self.subtree = Subtree(plan.id, path, blackboard, [])
        self.plan = plan
        self.document = plan.definition.document
        self.prefix = f"{path}/" if path else ""
        self.report = partial(collector.report, self.document)


@mypyc_attr(allow_interpreted_subclasses=True)
class NodeCreator:
    """Creates the nodes of a planned tree and of its subtrees, depth-first.

    A subclass may override `bind_ports`, `create_scope` and `create_node`, as `btcore.lint.dry_run.DryRun`.

    Attributes:
        format: The format of the tree, 3 or 4.
        enums: The enum names that scripts may use, with their numbers.
        context: The objects that the nodes share.
        blackboard: The main tree's blackboard.
        drafts: The drafts of trees, the main tree first.
        nodes: All nodes in depth-first pre-order; the content of a SubTree node follows it.
        collector: Collects the errors.
    """

    def __init__(
        self, plans: Plans, resources: Sequence[object], clock: Clock, blackboard: Blackboard | None = None
    ) -> None:
        self._plans = plans
        self.format = plans.format
        # Most registries have no substitution rules; then the manifests of the plan are used as they are.
        self._rules = plans.registry.substitutions
        self.enums = plans.registry.types.enums
        self._resources = Resources(resources)  # to which the tree adds its own instances of TreeResource
        self.context = TreeContext(clock)
        self._scope_class = Blackboard
        if self.format == 3:
            from btcore.blackboard.format3 import Format3Blackboard

            self._scope_class = Format3Blackboard
        self.blackboard = blackboard if blackboard is not None else self._scope_class(clock=clock)
        self.drafts: list[SubtreeDraft] = []
        self.nodes: list[TreeNode] = []
        # The main tree's path is the empty text, as in BehaviorTree.CPP.
        self._paths: set[str] = {""}
        self._declarations: dict[Entry, tuple[Binding, NodeConfig]] = {}
        self.collector = DiagnosticCollector()

    def create_nodes(self, tree_plan: TreePlan) -> None:
        """Create the nodes of *tree_plan*, which is neither recursive nor too large."""
        self._plans.sizes[tree_plan.id].ensure_recursion_limit()
        self._create_subtree(tree_plan, "", self.blackboard)

    def _create_subtree(self, tree_plan: TreePlan, path: str, blackboard: Blackboard) -> TreeNode:
        draft = SubtreeDraft(tree_plan, path, blackboard, self.collector)
        self.drafts.append(draft)
        assert tree_plan.root is not None
        return self._create_with_children(tree_plan.root, draft)

    def _create_with_children(self, node_plan: NodePlan, draft: SubtreeDraft) -> TreeNode:
        call = node_plan.subtree_call
        config = self._create_config(node_plan, draft)
        if call is not None:
            self._check_path(node_plan, config.path, draft)
        else:
            self.bind_ports(node_plan, config, draft)
        manifest = self._substitute(node_plan, config, draft) if self._rules else node_plan.manifest
        if call is None and not node_plan.children:
            leaf = self.create_node(node_plan, manifest, config, draft, [])
            self.nodes.append(leaf)
            draft.subtree.nodes.append(leaf)
            return leaf
        # Nodes are listed in pre-order, but a parent is created after its children.
        index, own_index = len(self.nodes), len(draft.subtree.nodes)
        self.nodes.append(_PLACEHOLDER)
        draft.subtree.nodes.append(_PLACEHOLDER)
        children: list[TreeNode]
        if self._rules and not takes_children(manifest):
            children = []  # a substitution rule has replaced the node by a leaf
        elif call is not None:
            inner = self.create_scope(node_plan, call, draft)
            children = [self._create_subtree(self._plans.trees[call.tree_id], config.path, inner)]
        else:
            children = [self._create_with_children(child, draft) for child in node_plan.children]
        node = self.create_node(node_plan, manifest, config, draft, children)
        self.nodes[index] = draft.subtree.nodes[own_index] = node
        return node

    def _create_config(self, node_plan: NodePlan, draft: SubtreeDraft) -> NodeConfig:
        """Return the configuration of the next node, without its ports."""
        call, own_name = node_plan.subtree_call, node_plan.name
        uid = len(self.nodes) + 1
        attributes = node_plan.attributes
        if call is None:
            default_name = node_plan.id
            is_named = own_name is not None and own_name != default_name
        else:
            default_name = call.tree_id
            attributes = {**call.port_texts, **attributes}
            # Format 3 ignores the name of a SubTree node in paths.
            is_named = own_name is not None and self.format == 4
        name = default_name if own_name is None else own_name
        config = NodeConfig(
            node_plan.id,
            name,
            uid,
            self.format,
            file=draft.document.file,
            line=draft.document.line(node_plan.element),
            conditions=node_plan.conditions,
            attributes=attributes,
            enums=self.enums,
        )
        # The path of a node without a name ends with the uid, as in BehaviorTree.CPP.
        config.path = draft.prefix + (name if is_named else f"{default_name}::{uid}")
        return config

    def bind_ports(self, node_plan: NodePlan, config: NodeConfig, draft: SubtreeDraft) -> None:
        """Bind the ports, and declare the entries that the ports point to."""
        if not node_plan.bindings:
            return
        blackboard = draft.subtree.blackboard
        inputs: dict[str, Input] = {}
        outputs: dict[str, Output] = {}
        for binding in node_plan.bindings:
            port = binding.port
            key = binding.key
            if key is not None and binding.is_explicit:
                try:
                    entry = blackboard.declare(key, port.type, only_read=not port.writes)
                except (BlackboardError, ConversionError) as error:
                    self._report_type_conflict(node_plan, port, draft, blackboard.find(key), error)
                else:
                    # The first port with a type declares the type; later ports are compared with it.
                    if entry not in self._declarations and port.type.strong:
                        self._declarations[entry] = (binding, config)
            if isinstance(binding, Input):
                inputs[port.name] = binding.bind(blackboard)
            # In format 3 the default of an output port is not connected.
            if port.writes and (binding.is_explicit or (key is not None and binding.format == 4)):
                outputs[port.name] = Output(binding, blackboard)
        config.inputs = inputs
        if outputs:
            config.outputs = outputs

    def declared_by(self, entry: Entry) -> str:
        """Return the port that declared the type of *entry*, with its place, or ""."""
        if entry not in self._declarations:
            return ""
        binding, config = self._declarations[entry]
        return f"'{binding.port.name}' of <{config.id}> ({config.where})"

    def _report_type_conflict(
        self, node_plan: NodePlan, port: Port, draft: SubtreeDraft, entry: Entry | None, error: BtcoreError
    ) -> None:
        message, hint = str(error), ""
        if entry is not None and not entry.declared.same(port.type):
            own, declared = port.type.name, entry.declared.name
            if own == declared:
                own += f" of {library_of(port.type.python_type)}"
                declared += f" of {library_of(entry.declared.python_type)}"
            types = f"has the type {own}, but its entry has the type {declared}"
            message = f"the port '{port.name}' of <{node_plan.id}> {types}"
            first = self.declared_by(entry)
            origin = f"declared by {first}" if first else "it was on the blackboard before the tree was built"
            hint = f"{origin}; the type of an entry never changes"
            if self.format == 4 and entry.declared.is_related(port.type):
                name = entry.declared.name
                hint = f"{origin}; an output needs exactly this type, so declare the port as {name}"
        draft.report(CONFLICTING_ENTRY_TYPES, message, node_plan.element, attribute=port.name, hint=hint)

    def create_node(
        self,
        node_plan: NodePlan,
        manifest: Manifest,
        config: NodeConfig,
        draft: SubtreeDraft,
        children: list[TreeNode],
    ) -> TreeNode:
        """Create a node. Return a placeholder if it or a child could not be created, which is reported."""
        if _PLACEHOLDER in children:
            return _PLACEHOLDER
        try:
            board = draft.subtree.blackboard
            return manifest.create_node(config, self.context, board, self._resources, children)
        except ScriptError as error:
            if not report_invalid_scripts(node_plan, draft.document, self.enums, self.collector):
                # The code of a leaf has compiled a script of its own.
                message = f"a script of <{node_plan.id}>: {error}"
                draft.report(SCRIPT_SYNTAX, message, node_plan.element)
        except (NodeError, BlackboardError, ConversionError) as error:
            self._report_rejection(node_plan, draft, error)
        except BtcoreError:
            raise  # an error of the program, not of the document
        except Exception as error:
            message = f"<{node_plan.id}> raised while it was created: {type(error).__name__}: {error}"
            hint = ""
            if isinstance(error, TypeError) and str(error).startswith("object.__init__()"):
                hint = "call super().__init__() without arguments: a node has its name and config already"
            draft.report(LEAF_INIT_RAISED, message, node_plan.element, hint=hint)
        return _PLACEHOLDER

    def _report_rejection(self, node_plan: NodePlan, draft: SubtreeDraft, error: BtcoreError) -> None:
        if not isinstance(error, NodeError):
            draft.report(INCONVERTIBLE_TEXT, str(error), node_plan.element)
            return
        set_names = {binding.name for binding in node_plan.bindings}
        missing = {
            port.name: _SCRIPT_EXAMPLES.get(port.role, f"{{{port.name}}}")
            for port in node_plan.manifest.ports.values()
            if port.role in LOAD_TIME_ROLES and port.name not in set_names
        }
        if missing:
            hint = "write " + " ".join(f'{name}="…"' for name in missing)
            fixes = [SetAttributes(missing)]
            draft.report(MISSING_PORT, str(error), node_plan.element, hint=hint, fixes=fixes)
        else:
            draft.report(NODE_NOT_CREATED, str(error), node_plan.element)

    def _substitute(self, node_plan: NodePlan, config: NodeConfig, draft: SubtreeDraft) -> Manifest:
        """Return the manifest after the registry's substitution rules; that of the plan after an error."""
        # A SubTree node has the root of the called tree as its only child.
        children = len(node_plan.children) if node_plan.subtree_call is None else 1
        try:
            return self._plans.registry.apply_substitutions(config, node_plan.manifest, children)
        except NodeError as error:
            draft.report(NODE_NOT_CREATED, str(error), node_plan.element)
            return node_plan.manifest

    # --- SubTree elements

    def _check_path(self, node_plan: NodePlan, path: str, draft: SubtreeDraft) -> None:
        if path in self._paths:
            message = f"two SubTree nodes have the path '{path}'"
            hint = "give them different names, or remove the names"
            draft.report(DUPLICATE_SUBTREE_PATH, message, node_plan.element, attribute="name", hint=hint)
        self._paths.add(path)

    def create_scope(self, node_plan: NodePlan, call: SubtreeCall, draft: SubtreeDraft) -> Blackboard:
        """Return the blackboard of the called tree, connected with that of *draft*, which calls it."""
        outer = draft.subtree.blackboard
        if call.shares_blackboard:
            return outer
        inner = self._scope_class(outer)
        for key, outer_key in call.remaps.items():
            inner.remap(key, outer_key)
        for key, text in call.constants.items():
            # `set` follows autoremap: it writes the outer entry if autoremap comes before the constant.
            inner.autoremap = key in call.outer_constants
            value = parse_constant(text) if self.format == 4 else text
            try:
                inner.set(key, value, None if isinstance(value, str) else type_of(value))
            except BlackboardError as error:
                draft.report(CONFLICTING_ENTRY_TYPES, str(error), node_plan.element, attribute=key)
        inner.autoremap = call.autoremap
        return inner
