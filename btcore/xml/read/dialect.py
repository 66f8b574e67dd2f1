"""The table of differences between the XML of BehaviorTree.CPP 4 and 3, and the names of attributes."""

from typing import Final, NamedTuple

from btcore.status import NodeType

# Explicit tags name the kind of a node; its ID is an attribute.
EXPLICIT_TAGS: Final = {
    "Action": NodeType.ACTION,
    "Condition": NodeType.CONDITION,
    "Control": NodeType.CONTROL,
    "Decorator": NodeType.DECORATOR,
}
PRECONDITION_ATTRIBUTES: Final = ("_failureIf", "_successIf", "_skipIf", "_while")
POSTCONDITION_ATTRIBUTES: Final = ("_onHalted", "_onFailure", "_onSuccess", "_post")
SCRIPT_ATTRIBUTES: Final = frozenset(PRECONDITION_ATTRIBUTES + POSTCONDITION_ATTRIBUTES)
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
    """The rules of one XML format.

    - *subtree_tags*: the tags that call a subtree.
    - *closed_tags*: those of them whose content is not checked: children are an error already.
    - *ignoring_tags*: those of them whose children are checked, but ignored.
    - *reserved*: attributes of a node that are never ports.
    - *has_conditions*: nodes have pre- and post-conditions, and names without control characters.
    - *free_underscore*: any other attribute whose name is not a valid port name is allowed and ignored.
    - *last_tree_wins*: the last of several trees with the same ID is used, otherwise the first.
    - *explicit_by_id*: the type of a node such as `<Action ID="…">` comes from its ID, not from its tag.
    - *literals_checked*: a text that doesn't convert to the port's type is an error when the tree is loaded.
    - *controls_need_children*: control nodes that must have children if their ID is the tag (None = all).
    - *leaves_checked*: children of a leaf whose ID is the tag are an error.
    - *tree_ids_checked*: the ID of a tree must be a valid name, and not the name of a node.
    - *max_depth*: maximum depth of elements below a BehaviorTree.
    """

    format: int
    subtree_tags: frozenset[str]
    closed_tags: frozenset[str]
    ignoring_tags: frozenset[str]
    reserved: frozenset[str]
    has_conditions: bool
    free_underscore: bool
    last_tree_wins: bool
    explicit_by_id: bool
    literals_checked: bool
    controls_need_children: frozenset[str] | None
    leaves_checked: bool
    tree_ids_checked: bool
    max_depth: int


DIALECTS: Final = {
    4: Dialect(
        format=4,
        subtree_tags=frozenset({"SubTree"}),
        closed_tags=frozenset(),
        ignoring_tags=frozenset(),
        reserved=frozenset({"ID", "name"}) | SCRIPT_ATTRIBUTES,
        has_conditions=True,
        free_underscore=True,
        last_tree_wins=True,
        explicit_by_id=True,
        literals_checked=True,
        controls_need_children=None,
        leaves_checked=True,
        tree_ids_checked=True,
        max_depth=256,
    ),
    3: Dialect(
        format=3,
        subtree_tags=frozenset({"SubTree", "SubTreePlus"}),
        closed_tags=frozenset({"SubTree"}),
        ignoring_tags=frozenset({"SubTreePlus"}),
        reserved=frozenset({"ID", "name", "_description"}),
        has_conditions=False,
        free_underscore=False,
        last_tree_wins=False,
        explicit_by_id=False,
        literals_checked=False,
        controls_need_children=frozenset({"Sequence", "SequenceStar", "Fallback"}),
        leaves_checked=False,
        tree_ids_checked=False,
        max_depth=256,
    ),
}
