"""The tags of elements in the XML of BehaviorTree.CPP 4 (format 4) and 3 (format 3)."""

from typing import Final

from btcore.blackboard.ports import Direction
from btcore.status import NodeType

# Explicit tags name the type of a node; its ID is an attribute.
EXPLICIT_TAGS: Final = {
    "Action": NodeType.ACTION,
    "Condition": NodeType.CONDITION,
    "Control": NodeType.CONTROL,
    "Decorator": NodeType.DECORATOR,
}
# The elements of a TreeNodesModel.
MODEL_TAGS: Final = {**EXPLICIT_TAGS, "SubTree": NodeType.SUBTREE}
# The elements of a model that declare ports.
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

# The tags that call a subtree, by format.
SUBTREE_TAGS: Final = {4: frozenset({"SubTree"}), 3: frozenset({"SubTree", "SubTreePlus"})}
# In format 3, of the control nodes whose tag is their ID only these need a child.
CONTROLS_WITH_CHILDREN_IN_3: Final = frozenset({"Sequence", "SequenceStar", "Fallback"})
