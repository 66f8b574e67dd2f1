"""What differs between the XML of BehaviorTree.CPP 4 and 3: one table, and the words for it."""

from dataclasses import dataclass
from typing import Final

from btcore.status import NodeType

# Tags that name a category, the node's ID being an attribute.
EXPLICIT_TAGS: Final = {
    "Action": NodeType.ACTION,
    "Condition": NodeType.CONDITION,
    "Control": NodeType.CONTROL,
    "Decorator": NodeType.DECORATOR,
}
PRECONDITION_ATTRIBUTES: Final = ("_failureIf", "_successIf", "_skipIf", "_while")
POSTCONDITION_ATTRIBUTES: Final = ("_onHalted", "_onFailure", "_onSuccess", "_post")
SCRIPT_ATTRIBUTES: Final = frozenset(PRECONDITION_ATTRIBUTES + POSTCONDITION_ATTRIBUTES)
# Renamed or dropped since format 3; Groot 1 wrote the first of each pair.
NODE_REPLACEMENTS: Final = {
    "SequenceStar": "SequenceWithMemory",
    "SubTreePlus": "SubTree",
    "BlackboardCheckInt": "Precondition",
    "BlackboardCheckDouble": "Precondition",
    "BlackboardCheckString": "Precondition",
    "BlackboardCheckBool": "Precondition",
    "RetryUntilSuccesful": "RetryUntilSuccessful",
}


@dataclass(frozen=True, slots=True)
class Dialect:
    """The rules of one format.

    - *subtree_tags*: the tags that call a subtree.
    - *reserved*: attributes of a node that are never ports; *free_underscore*: nor is any other
      attribute that can't be the name of a port.
    - *last_tree_wins*: of two trees of one ID.
    - *explicit_by_id*: the children of an explicit tag are counted by the kind of its node, not by the tag.
    - *literals_checked*: a text that doesn't convert to the port's type is refused at load.
    - *controls_need_children*: which compact control nodes may not be empty (None = all).
    - *leaves_checked*: compact leaves may have no children.
    - *tree_ids_checked*: a tree may not be called as a node is.
    - *max_depth* of elements below a BehaviorTree.
    """

    format: int
    subtree_tags: frozenset[str]
    reserved: frozenset[str]
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
        reserved=frozenset({"ID", "name"}) | SCRIPT_ATTRIBUTES,
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
        reserved=frozenset({"ID", "name", "_description"}),
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


def parse_format(written: str | None) -> int | None:
    """The format that a `BTCPP_format` asks for; None if it is none that is known.

    Without the attribute a document is of format 3, as Groot 1 writes.
    """
    if written is None:
        return 3
    return {"3": 3, "4": 4}.get(written.strip())
