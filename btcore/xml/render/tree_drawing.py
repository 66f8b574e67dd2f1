"""Collect what a drawing of a tree shows: names, ports and scripts of its nodes."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from btcore.blackboard.ports import SCRIPT_ROLES, Port
from btcore.engine.node import TreeNode
from btcore.status import NodeType
from btcore.tree.tree import Tree
from btcore.xml.plan.document_checks import DocumentAnalysis
from btcore.xml.plan.plan import NodePlan, TreePlanner


@dataclass(slots=True)
class DiagramNode:
    """One node of a drawing, with its children.

    Attributes:
        uid: Number of the node in the running tree.
        id: ID of the node.
        name: Name of the node.
        type: Kind of the node.
        ports: The ports that the document sets, as (name, text, direction), such as ``("goal", "{g}",
            "input")``; the direction of a script is "script".
        scripts: Pre- and post-conditions, by attribute.
        about: Description of the node.
        tree: For a SubTree node, the ID of the called tree, whose root is the only child.
        symbol: The symbol that the node's class declares.
        children: The children of the node.
    """

    uid: int
    id: str
    name: str
    type: NodeType
    ports: list[tuple[str, str, str]]
    scripts: Mapping[str, str]
    about: str = ""
    tree: str = ""
    symbol: str = ""
    children: list["DiagramNode"] = field(default_factory=list)


def diagram_of_tree(tree: Tree) -> DiagramNode:
    """Return a running tree as a drawing. Ports with their default value are not shown."""
    trees = {subtree.path: subtree.id for subtree in tree.subtrees[1:]}

    def of(node: TreeNode) -> DiagramNode:
        config = node.config
        manifest = tree.registry.get(node.id, tree.format)
        declared: Mapping[str, Port] = manifest.ports if manifest is not None else {}
        texts = {name: port.text for name, port in config.outputs.items()}
        texts.update((name, port.text) for name, port in config.inputs.items())
        ports = [
            (name, texts[name], _direction(port))
            for name, port in declared.items()
            if name in texts and texts[name] != port.default
        ]
        sketch = DiagramNode(node.uid, node.id, node.name, node.type, ports, config.scripts)
        if manifest is not None:
            sketch.about, sketch.symbol = manifest.description, manifest.cls.node_symbol
        if node.type is NodeType.SUBTREE:
            sketch.tree = trees[node.path]
            sketch.ports = [(name, text, "") for name, text in config.attributes.items() if name[:1] != "_"]
        sketch.children = [of(child) for child in node.children]
        return sketch

    return of(tree.root)


def diagram_of_document(analysis: DocumentAnalysis) -> DiagramNode:
    """Return the main tree of a document without errors as a drawing, numbered as in a running tree."""
    assert analysis.main is not None, "a document without a main tree has errors"
    return _Numbering(analysis.planner).of_tree(analysis.main.id)


def _direction(port: Port) -> str:
    return "script" if port.role in SCRIPT_ROLES else port.direction.value


class _Numbering:
    """Converts plans to diagram nodes, depth first, and numbers them."""

    def __init__(self, planner: TreePlanner) -> None:
        self._planner = planner
        self._uid = 0

    def of_tree(self, id: str) -> DiagramNode:
        """Return the root of the tree *id*."""
        root = self._planner.plan(self._planner.definitions.by_id[id]).root
        assert root is not None, "the tree has been checked"
        return self._of(root)

    def _of(self, plan: NodePlan) -> DiagramNode:
        self._uid += 1
        call = plan.call
        about, symbol = "", ""
        if plan.manifest is not None:
            about, symbol = plan.manifest.description, plan.manifest.cls.node_symbol
        if call is not None:
            ports = [(name, text, "") for name, text in call.written.items()]
            name = plan.name or call.tree
            sketch = DiagramNode(
                self._uid, plan.id, name, NodeType.SUBTREE, ports, plan.scripts, about, call.tree, symbol
            )
            sketch.children = [self.of_tree(call.tree)]
            return sketch
        kind = plan.manifest.type if plan.manifest is not None else NodeType.UNDEFINED
        ports = [(port.name, text, _direction(port)) for port, text, written in plan.ports if written]
        sketch = DiagramNode(self._uid, plan.id, plan.name or plan.id, kind, ports, plan.scripts, about)
        sketch.symbol = symbol
        sketch.children = [self._of(child) for child in plan.children]
        return sketch
