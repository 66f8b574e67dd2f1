"""Collect what a drawing of a tree shows: names, ports and scripts of its nodes."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field

from btcore.blackboard.ports import SCRIPT_ROLES, Port
from btcore.status import NodeType
from btcore.xml.plan.plan import Plans
from btcore.xml.plan.tree_plan import NodePlan, TreePlan
from btcore.xml.read.document import Document
from btcore.xml.read.element import Element


@dataclass(slots=True)
class DiagramNode:
    """One node of a drawing, with its children.

    Attributes:
        uid: Number of the node in the running tree.
        id: ID of the node.
        name: Name of the node.
        type: Type of the node.
        ports: The ports that the document sets, as (name, text, direction), such as `("goal", "{g}",
            "input")`; the direction of a script is "script", of a port of a SubTree "".
        conditions: Pre- and post-conditions, by attribute.
        about: Description of the node.
        tree: For a SubTree node, the ID of the called tree, whose root is the only child.
        symbol: The symbol that the node's class declares.
        children: The children of the node.
        hidden: The number of descendants that the drawing omits; a badge shows it.
        origin: The document and the element of the node, or None if it has no element.
    """

    uid: int
    id: str
    name: str
    type: NodeType
    ports: list[tuple[str, str, str]]
    conditions: Mapping[str, str]
    about: str = ""
    tree: str = ""
    symbol: str = ""
    children: list["DiagramNode"] = field(default_factory=list)
    hidden: int = 0
    origin: tuple[Document, Element] | None = None


def diagram_of_document(plans: Plans) -> DiagramNode:
    """Return the main tree of a document without errors as a drawing, numbered as in a running tree."""
    assert plans.main_tree is not None, "a document without a main tree has errors"
    plans.sizes[plans.main_tree.id].ensure_recursion_limit()
    # NodeCreator numbers the nodes in the same order: a parent before its children.
    uids = itertools.count(1)

    def of_tree(tree: TreePlan) -> DiagramNode:
        assert tree.root is not None, "the tree has been checked"
        return of_node(tree.root, tree.definition.document)

    def of_node(plan: NodePlan, document: Document) -> DiagramNode:
        manifest, call = plan.manifest, plan.subtree_call
        sketch = DiagramNode(
            uid=next(uids),
            id=plan.id,
            name=plan.name or (plan.id if call is None else call.tree_id),
            type=manifest.type,
            ports=[
                (binding.name, binding.text, _direction(binding.port))
                for binding in plan.bindings
                if binding.is_explicit
            ],
            conditions=plan.conditions,
            about=manifest.description,
            symbol=manifest.spec.symbol,
            origin=(document, plan.element),
        )
        if call is not None:
            sketch.type = NodeType.SUBTREE
            sketch.ports = [(name, text, "") for name, text in call.port_texts.items()]
            sketch.tree = call.tree_id
            sketch.children = [of_tree(plans.trees[call.tree_id])]
        else:
            sketch.children = [of_node(child, document) for child in plan.children]
        return sketch

    return of_tree(plans.main_tree)


def _direction(port: Port) -> str:
    return "script" if port.role in SCRIPT_ROLES else port.direction.value
