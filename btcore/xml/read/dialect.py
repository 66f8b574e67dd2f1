"""The table of differences between the XML of BehaviorTree.CPP 4 and 3, and the names of elements."""

from typing import Final, NamedTuple

from btcore.blackboard.ports import Direction
from btcore.status import NodeType

# Explicit tags name the type of a node; its ID is an attribute.
EXPLICIT_TAGS: Final = {
    "Action": NodeType.ACTION,
    "Condition": NodeType.CONDITION,
    "Control": NodeType.CONTROL,
    "Decorator": NodeType.DECORATOR,
}
# The elements of a TreeNodesModel that declare ports.
PORT_TAGS: Final = {f"{direction.value}_port": direction for direction in Direction}
# Nodes renamed or dropped since format 3, as Groot 1 writes them, and their replacements in format 4.
NODE_REPLACEMENTS: Final = {
    "SequenceStar": "SequenceWithMemory",
    "SubTreePlus": "SubTree",
    "BlackboardCheckInt": "Precondition",
    "BlackboardCheckDouble": "Precondition",
    "BlackboardCheckString": "Precondition",
    "BlackboardCheckBool": "Precondition",
    "RetryUntilSuccesful": "RetryUntilSuccessful",
}


class Dialect(NamedTuple):
    """The rules of one XML format; by default those of format 4.

    Attributes:
        subtree_tags: The tags that call a subtree.
        tags_with_unchecked_children: Those of them whose children are an error, and are not checked.
        tags_with_ignored_children: Those of them whose children are checked, but ignored.
        comment_attributes: Attributes of a node that are kept, although they are neither ports nor scripts.
        has_conditions: Whether nodes have pre- and post-conditions.
        allows_non_port_attributes: Whether another attribute is ignored if its name is not a valid port name.
        last_tree_wins: Whether the last of several trees with the same ID is used; otherwise, the first is.
        type_from_id: Whether the ID of a node such as `<Action ID="…">` determines its type; else its tag.
        requires_explicit_tag_for_id: Whether only an explicit tag such as `<Action ID="…">` may have an ID.
        checks_literals: Whether a text that does not convert to the type of its port is an error of loading.
        controls_requiring_children: The control nodes that need a child if their ID is the tag; None = all.
        checks_leaf_children: Whether children of a leaf whose ID is the tag are an error.
        checks_names: Whether the ID of a tree must be a valid name, and not the name of a node, the names of
            ports in models of subtrees must be valid, and names of nodes must have no control characters.
    """

    format: int = 4
    subtree_tags: frozenset[str] = frozenset({"SubTree"})
    tags_with_unchecked_children: frozenset[str] = frozenset()
    tags_with_ignored_children: frozenset[str] = frozenset()
    comment_attributes: frozenset[str] = frozenset()
    has_conditions: bool = True
    allows_non_port_attributes: bool = True
    last_tree_wins: bool = True
    type_from_id: bool = True
    requires_explicit_tag_for_id: bool = True
    checks_literals: bool = True
    controls_requiring_children: frozenset[str] | None = None
    checks_leaf_children: bool = True
    checks_names: bool = True


DIALECTS: Final = {
    4: Dialect(),
    3: Dialect(
        format=3,
        subtree_tags=frozenset({"SubTree", "SubTreePlus"}),
        tags_with_unchecked_children=frozenset({"SubTree"}),
        tags_with_ignored_children=frozenset({"SubTreePlus"}),
        comment_attributes=frozenset({"_description"}),
        has_conditions=False,
        allows_non_port_attributes=False,
        last_tree_wins=False,
        type_from_id=False,
        requires_explicit_tag_for_id=False,
        checks_literals=False,
        controls_requiring_children=frozenset({"Sequence", "SequenceStar", "Fallback"}),
        checks_leaf_children=False,
        checks_names=False,
    ),
}
