"""What a running tree looks like, whoever runs it: its nodes, and what happened to them, in order.

Everything between the wire and the screen is said in these words. Times: *t* is the tree's own
clock in ns, *wall* is ns since the epoch. A C++ robot sends no clock of its own, so there *t*
counts from the first thing seen.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from btcore_scene import MovingScene, StaticScene

Kind = Literal["action", "condition", "control", "decorator", "subtree"]
"""The family of a node."""

ConnectionState = Literal["waiting", "connected", "lost", "ended"]
"""How it stands with the robot: not there yet · heard · silent since a while · has said goodbye."""

Topic = Literal["transitions", "ticks", "exceptions", "blackboard"]
"""What a robot may tell of, beside its tree: changes of statuses · when the root was ticked, and what that
cost · nodes that raised · the blackboards."""

IDLE: Final = 0
RUNNING: Final = 1
SUCCESS: Final = 2
FAILURE: Final = 3
SKIPPED: Final = 4

STATUS_NAMES: Final = ("IDLE", "RUNNING", "SUCCESS", "FAILURE", "SKIPPED")
"""Names by number; the numbers are BehaviorTree.CPP's."""


def kind_from_children(count: int) -> Kind:
    """Return the family of a node without a model, inferred from its *count* of children."""
    if not count:
        return "action"
    return "decorator" if count == 1 else "control"


@dataclass(frozen=True, slots=True)
class ObservedNode:
    """One node of a running tree.

    *uid* counts from 1; *id* is the registration ID (for a SubTree node ``SubTree``) and *name*
    what people call it; *path* is the full path by BehaviorTree.CPP's rule; *parent* is a uid (0
    for the root); *ports* maps a port to its text in the XML (``{key}``, ``0.5``) and a condition
    to its script; *subtree* is the path of the subtree instance that the node belongs to (``""``:
    the main tree).
    """

    uid: int
    name: str
    id: str
    kind: Kind
    path: str
    parent: int = 0
    children: tuple[int, ...] = ()
    ports: Mapping[str, str] = field(default_factory=dict)
    subtree: str = ""


@dataclass(frozen=True, slots=True)
class ObservedTree:
    """A whole tree: depth-first, parents first, a subtree's content right after its SubTree node.

    *tree_id* is new for every start of a robot (32 hex digits); *name* is the main tree's ID;
    *subtrees* maps an instance's path (``""``: main) to its tree ID, in order of creation; *xml* is the
    full tree as the robot sent it (empty if it sent another form).
    """

    tree_id: str
    name: str
    nodes: tuple[ObservedNode, ...]
    subtrees: Mapping[str, str] = field(default_factory=dict)
    xml: bytes = field(default=b"", repr=False, compare=False)
    by_uid: Mapping[int, ObservedNode] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "by_uid", {node.uid: node for node in self.nodes})

    @property
    def root(self) -> ObservedNode:
        """The node that is ticked."""
        return self.nodes[0]

    def ancestors(self, uid: int) -> Iterator[ObservedNode]:
        """The parent of *uid*, its parent, and so on up to the root."""
        above = self.by_uid[uid].parent
        while above:
            node = self.by_uid[above]
            yield node
            above = node.parent

    def depth(self, uid: int) -> int:
        """How many nodes are above *uid*."""
        return sum(1 for _ in self.ancestors(uid))


@dataclass(frozen=True, slots=True)
class DataSource:
    """How a robot tells of its tree. *name* is the protocol's; *unavailable* says, by topic, what isn't sent.

    A topic that isn't in *unavailable* is told of completely.
    """

    name: str
    unavailable: Mapping[Topic, str] = field(default_factory=dict)


SCENE_CHANNEL: Final = DataSource("btcore's scene channel")
"""The one that lacks nothing."""


@dataclass(frozen=True, slots=True)
class TreeSeen:
    """A tree was met: first of all, and again when the robot came back with another one.

    *statuses* maps every uid to its status at that moment. *numbered* is true if transitions
    carry the robot's own numbers, so that a missing one shows; *source* says what else is not to be seen.
    The same tree again means that transitions between are unknown.
    """

    tree: ObservedTree
    t: int
    wall: int
    statuses: Mapping[int, int]
    numbered: bool = True
    source: DataSource = SCENE_CHANNEL


@dataclass(frozen=True, slots=True)
class StatusChanged:
    """One node went from *previous* to *status*; *number* counts from 1 within a tree, without holes."""

    number: int
    t: int
    wall: int
    tick: int
    uid: int
    previous: int
    status: int


@dataclass(frozen=True, slots=True)
class Ticked:
    """The root was ticked for the *tick*-th time; it took *duration_ns* of wall time."""

    tick: int
    t: int
    wall: int
    duration_ns: int
    status: int


@dataclass(frozen=True, slots=True)
class BlackboardSeen:
    """All blackboards: subtree path (``""``: main) → key → value (None: declared, not written)."""

    t: int
    wall: int
    boards: Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class SceneStatic:
    """What does not change during a run."""

    data: StaticScene


@dataclass(frozen=True, slots=True)
class SceneMoving:
    """What moved or changed."""

    t: int
    wall: int
    data: MovingScene


@dataclass(frozen=True, slots=True)
class ExceptionRaised:
    """The node at *path* raised; *message* is the whole sentence."""

    t: int
    wall: int
    path: str
    message: str


@dataclass(frozen=True, slots=True)
class TransitionsLost:
    """The transitions *first* to *last* (both included) are lost for good."""

    first: int
    last: int


@dataclass(frozen=True, slots=True)
class DataMissed:
    """Something of *topic* went unseen between the tree's time *since* and *t*: how much, nobody knows.

    That is for robots whose transitions have no numbers; else it is a :class:`TransitionsLost`. *reason* is
    a sentence.
    """

    t: int
    wall: int
    since: int
    topic: Topic
    reason: str


@dataclass(frozen=True, slots=True)
class ConnectionChanged:
    """How it stands with the robot from now on; *detail* is a sentence for people."""

    state: ConnectionState
    detail: str = ""


Event = (
    TreeSeen
    | StatusChanged
    | Ticked
    | BlackboardSeen
    | SceneStatic
    | SceneMoving
    | ExceptionRaised
    | TransitionsLost
    | DataMissed
    | ConnectionChanged
)
"""Anything that a feed tells, in the order in which it happened."""
