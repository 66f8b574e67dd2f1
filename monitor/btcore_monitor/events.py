"""The nodes of a running tree, and the events of a robot, independent of the protocol.

Feeds convert all protocols to these types, and screens and log writers read them. Times: *stamp* is the
tree's clock in ns, *wall* is ns since the epoch. A C++ robot does not send the time of its tree, so for such
a robot *stamp* counts from the first message.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, get_args

from btcore_scene import MovingScene, StaticScene

NodeTypeName = Literal["action", "condition", "control", "decorator", "subtree"]
"""The type of a node."""

NODE_TYPES: Final[tuple[NodeTypeName, ...]] = get_args(NodeTypeName)
"""All types of nodes, in the order of BehaviorTree.CPP's enum NodeType, whose ACTION is 1."""

ConnectionState = Literal["waiting", "connected", "lost", "ended"]
"""The state of the connection to the robot.

It is `waiting` for the first contact, `connected`, `lost` (no contact for some time), or `ended` (the robot
has reported the end of its run).
"""

DataKind = Literal["transitions", "ticks", "exceptions", "blackboard", "messages"]
"""Data that a robot may send in addition to its tree.

They are transitions of statuses, ticks of the root with their duration, exceptions of nodes, and blackboards;
or messages of any kind.
"""

IDLE: Final = 0
RUNNING: Final = 1
SUCCESS: Final = 2
FAILURE: Final = 3
SKIPPED: Final = 4
STATUS_NAMES: Final = ("IDLE", "RUNNING", "SUCCESS", "FAILURE", "SKIPPED")
"""Names by number; the numbers are those of BehaviorTree.CPP's enum NodeStatus."""


def infer_node_type(count: int) -> NodeTypeName:
    """Return the type of a node without a model, inferred from its *count* of children.

    Examples:
        >>> from btcore_monitor.events import infer_node_type
        >>> [infer_node_type(count) for count in range(3)]
        ['action', 'decorator', 'control']
    """
    if not count:
        return "action"
    return "decorator" if count == 1 else "control"


@dataclass(frozen=True, slots=True)
class ObservedNode:
    """A node of a running tree.

    Attributes:
        uid: A number from 1 on, unique in the tree.
        name: The instance name.
        id: The registration ID (`SubTree` for a SubTree node).
        type: The type.
        path: The full path, as BehaviorTree.CPP 4 forms it.
        parent: The parent's uid (0 for the root).
        children: The children's uids.
        ports: The text in the XML by port (`{key}`, `0.5`), and the script by condition.
        subtree: The path of the subtree instance that contains the node (`""`: the main tree).
    """

    uid: int
    name: str
    id: str
    type: NodeTypeName
    path: str
    parent: int = 0
    children: tuple[int, ...] = ()
    ports: Mapping[str, str] = field(default_factory=dict)
    subtree: str = ""


@dataclass(frozen=True, slots=True)
class ObservedTree:
    """A running tree with all its nodes.

    Attributes:
        tree_id: 32 hexadecimal digits, which change when the robot restarts or replaces its tree.
        name: The main tree's ID.
        nodes: The nodes, depth-first, parents first, a subtree's content right after its SubTree node.
        subtrees: The tree's ID by the path of each subtree instance (`""`: main), in order of creation.
        xml: The full tree as the robot sent it, or empty if the robot sent another format.
        by_uid: The nodes by uid.

    Examples:
        >>> from btcore_monitor.events import ObservedNode, ObservedTree
        >>> root = ObservedNode(1, "round", "Sequence", "control", "round")
        >>> tree = ObservedTree("0" * 32, "Main", (root,))
        >>> tree.root.path, tree.by_uid[1].id
        ('round', 'Sequence')
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
        """The root node."""
        return self.nodes[0]

    def ancestors(self, uid: int) -> Iterator[ObservedNode]:
        """Yield the parent of *uid*, its parent, and so on up to the root."""
        above = self.by_uid[uid].parent
        while above:
            node = self.by_uid[above]
            yield node
            above = node.parent

    def depth(self, uid: int) -> int:
        """Return the number of ancestors of *uid*."""
        return sum(1 for _ in self.ancestors(uid))


@dataclass(frozen=True, slots=True)
class DataSource:
    """The source of a tree's data.

    *name* is the protocol or the kind of file. *unavailable* maps each kind of data that the source does not
    send, or not completely, to the reason. All other data is complete.
    """

    name: str
    unavailable: Mapping[DataKind, str] = field(default_factory=dict)


RUN_CHANNEL: Final = DataSource("btcore's run channel")
"""btcore's own protocol (wire/run_channel.py), the only source that sends all data completely."""


@dataclass(frozen=True, slots=True)
class TreeEvent:
    """The tree of a robot, which precedes all data about the tree.

    A new tree causes a new event. A second event with the same tree ID means that the transitions between the
    two events are unknown.

    Attributes:
        tree: The tree.
        stamp: The time of the tree (ns).
        wall: The wall-clock time (ns since the epoch).
        statuses: The status of every uid at that moment.
        has_transition_numbers: Whether the robot numbers the transitions, so that gaps are visible.
        source: The source of the data, which describes unavailable data.
        results: The last status of idle nodes by their uid, as far as the robot reports it.
    """

    tree: ObservedTree
    stamp: int
    wall: int
    statuses: Mapping[int, int]
    has_transition_numbers: bool = True
    source: DataSource = RUN_CHANNEL
    results: Mapping[int, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class TransitionEvent:
    """The status of a node changed.

    Attributes:
        number: The number of the transition in the tree, from 1.
        stamp: The time of the tree (ns).
        wall: The wall-clock time (ns since the epoch).
        tick: The number of the root's tick, or 0 if the robot does not send it.
        uid: The node.
        previous: The status before the change.
        status: The status after the change.
    """

    number: int
    stamp: int
    wall: int
    tick: int
    uid: int
    previous: int
    status: int


@dataclass(frozen=True, slots=True)
class TickEvent:
    """The root was ticked.

    Attributes:
        tick: The number of the tick, from 1.
        stamp: The time of the tree (ns).
        wall: The wall-clock time (ns since the epoch).
        duration_ns: The duration of the tick (ns of wall time).
        status: The number of the root's status.
    """

    tick: int
    stamp: int
    wall: int
    duration_ns: int
    status: int


@dataclass(frozen=True, slots=True)
class BlackboardEvent:
    """All blackboards: subtree path (`""`: main) → key → value (None: declared, but not written).

    Attributes:
        stamp: The time of the tree (ns).
        wall: The wall-clock time (ns since the epoch).
        boards: The values of the entries by subtree path and key.
    """

    stamp: int
    wall: int
    boards: Mapping[str, Mapping[str, Any]]


LeafTick = tuple[int, str, int, Mapping[str, str], Mapping[str, str], str]
"""A tick of a leaf of a recording.

It is the uid, the path, the number of the result (IDLE if the leaf raised an exception), the values of the
inputs and of the outputs as texts by name, and the text of the exception or "".
"""


@dataclass(frozen=True, slots=True)
class LeavesEvent:
    """The leaves that were ticked in a tick of the root, of a recording that is run again.

    Attributes:
        stamp: The time of the tree (ns).
        wall: The wall-clock time (ns since the epoch).
        tick: The number of the tick.
        leaves: The leaves, in the order in which they were ticked.
    """

    stamp: int
    wall: int
    tick: int
    leaves: tuple[LeafTick, ...]


@dataclass(frozen=True, slots=True)
class StaticSceneEvent:
    """The part of the scene that does not change during a run.

    Attributes:
        data: The scene.
    """

    data: StaticScene


@dataclass(frozen=True, slots=True)
class SavedSceneEvent:
    """The scene in a recording of the viewer, of the same run.

    Attributes:
        file: The recording.
        tick: The number of a tick.
        stamp: The time of this tick (ns), to which its scene is moved.
    """

    file: Path
    tick: int
    stamp: int


@dataclass(frozen=True, slots=True)
class MovingSceneEvent:
    """The part of the scene that moved or changed.

    Attributes:
        stamp: The time of the tree (ns).
        wall: The wall-clock time (ns since the epoch).
        data: The changed part of the scene.
    """

    stamp: int
    wall: int
    data: MovingScene


@dataclass(frozen=True, slots=True)
class ExceptionEvent:
    """A node raised an exception.

    Attributes:
        stamp: The time of the tree (ns).
        wall: The wall-clock time (ns since the epoch).
        path: The path of the node.
        message: The whole error message.
    """

    stamp: int
    wall: int
    path: str
    message: str


@dataclass(frozen=True, slots=True)
class LostTransitionsEvent:
    """The transitions *first* to *last* (both included) are lost and cannot be requested again."""

    first: int
    last: int


@dataclass(frozen=True, slots=True)
class MissingDataEvent:
    """An unknown amount of data was missed.

    This event is for robots without transition numbers, and for invalid messages; lost transitions with
    numbers are a `LostTransitionsEvent`.

    Attributes:
        stamp: The end of the gap (ns of the tree's time).
        wall: The wall-clock time (ns since the epoch).
        since: The beginning of the gap (ns of the tree's time).
        kind: The kind of the missing data.
        reason: A phrase for users.
    """

    stamp: int
    wall: int
    since: int
    kind: DataKind
    reason: str


@dataclass(frozen=True, slots=True)
class HooksEvent:
    """The robot has hooks of other clients, which may stop its tree.

    Attributes:
        stamp: The time of the tree (ns).
        wall: The wall-clock time (ns since the epoch).
        warning: A text for users.
    """

    stamp: int
    wall: int
    warning: str


@dataclass(frozen=True, slots=True)
class ConnectionEvent:
    """A change of the connection to the robot.

    Attributes:
        state: The new state.
        detail: A description for users.
    """

    state: ConnectionState
    detail: str = ""


Event = (
    TreeEvent
    | TransitionEvent
    | TickEvent
    | BlackboardEvent
    | LeavesEvent
    | StaticSceneEvent
    | SavedSceneEvent
    | MovingSceneEvent
    | ExceptionEvent
    | LostTransitionsEvent
    | MissingDataEvent
    | HooksEvent
    | ConnectionEvent
)
"""An event of a feed. A feed returns events in the order in which they happened."""
