"""What a recording consists of: the tree with its state, and for each tick what it depends on.

`btcore.engine.journal` records it in a running tree. The values are independent of the tree: nodes are
numbers (UIDs), scopes are indices, values have the form of `btcore_recorder.values`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from btcore.engine.node import TreeNode
from btcore.engine.recorded_events import InputEvent, RecordedEntry
from btcore.status import Status

UNKNOWN_CHECKSUM: Final = -1
"""The checksum of a tick that raised an exception, if the tree was not halted afterwards."""


class Result(NamedTuple):
    """The tick of an external node returned *status*."""

    uid: int
    status: Status


Input = Result | InputEvent


class Step(NamedTuple):
    """A tick of the root, or a halt of the whole tree.

    Attributes:
        tick: The number of the tick; 0 = a halt.
        time: The time (ns) at which the tick began; -1 for a halt.
        before: What happened since the previous step.
        inputs: What the step depends on, in order.
        status: The result of the tick; IDLE after a halt or an exception.
        checksum: The checksum of all transitions from the start of the segment to the end of the step; or
            `UNKNOWN_CHECKSUM`.
        woken_by: The UID of the node that requested the tick, −1 for a request by `Tree.wake`, 0 for no
            request; None = not known.
        transitions: The UID and the new status of each transition since the last step; None = not recorded.
    """

    tick: int
    time: int
    before: tuple[Input, ...]
    inputs: tuple[Input, ...]
    status: Status
    checksum: int
    woken_by: int | None = None
    transitions: tuple[tuple[int, Status], ...] | None = None


class NodeState(NamedTuple):
    """The state of a node between two ticks.

    Attributes:
        uid: The UID of the node.
        status: The status.
        status_before_reset: The status before it was last reset.
        fields: The values of its `spec.state_fields`; none for an external node.
    """

    uid: int
    status: Status
    status_before_reset: Status
    fields: Mapping[str, Any]


class TreeState(NamedTuple):
    """The state of a tree between two ticks.

    Attributes:
        entries: The entries.
        scopes: For each scope the keys of its entries, with their index in *entries*.
        nodes: The nodes that have state fields, or a status other than IDLE.
        ticks: The number of ticks so far.
    """

    entries: tuple[RecordedEntry, ...]
    scopes: tuple[Mapping[str, int], ...]
    nodes: tuple[NodeState, ...]
    ticks: int


class RecordedClass(NamedTuple):
    """The class of nodes with a registration ID, or of a node that a substitution rule has replaced.

    Attributes:
        id: The registration ID.
        kind: "leaf", "decorator" or "control" for external nodes; "built-in" for others, of which only *id*
            counts.
        node_type: The name of the node type.
        must_complete: Whether RUNNING is not a valid result.
        ports: For each port its name, its direction, the name of its type, and its default or None.
    """

    id: str
    kind: str
    node_type: str
    must_complete: bool
    ports: tuple[tuple[str, str, str, str | None], ...]


class LeafCode(NamedTuple):
    """The code of a leaf, or of another external node: its place, `file:line`, and a hash of the file."""

    place: str
    hash: str


class Facts(NamedTuple):
    """Facts about the run that a replay does not need. Older recordings do not have them.

    Attributes:
        run: Identifies the run: the same in all its files; "" = not known.
        tree: A hash of the documents; "" = not known.
        code: The code of external nodes, by registration ID.
        libraries: The versions of the packages of these nodes; "" = not known.
        resources: The full names of the types of the resources that these nodes take.
    """

    run: str = ""
    tree: str = ""
    code: Mapping[str, LeafCode] = {}
    libraries: Mapping[str, str] = {}
    resources: tuple[str, ...] = ()


class Head(NamedTuple):
    """The tree of a recording.

    Attributes:
        tree_id: The ID of the main tree.
        format: The XML format, 3 or 4.
        documents: The documents, as in `btcore.Tree.documents`.
        enums: The numbers of enum names in scripts.
        types: Descriptions of the user's types, by name.
        classes: The classes of external nodes.
        replaced: The classes of the nodes that substitution rules have replaced, by UID.
        outer: For the scope of the main tree and each parent whether it has automatic remapping, and its
            remappings.
        state: The state when the recording began.
        time: The time (ns) of the tree's clock when the recording began.
        wall_time: The same moment in ns since 1970.
        versions: What recorded the run: "btcore", "build" and "python".
        facts: Facts about the run.
        paths: The paths of the nodes, for people who read the file. A replay does not need them.
    """

    tree_id: str
    format: int
    documents: tuple[tuple[str, str, bool], ...]
    enums: Mapping[str, int]
    types: Mapping[str, Any]
    classes: tuple[RecordedClass, ...]
    replaced: Mapping[int, RecordedClass]
    outer: tuple[tuple[bool, Mapping[str, str]], ...]
    state: TreeState
    time: int
    wall_time: int
    versions: Mapping[str, str]
    facts: Facts = Facts()
    paths: tuple[str, ...] = ()

    def wall_time_at(self, time: int) -> int:
        """Return the time (ns since 1970) at a time (ns) of the tree's clock."""
        return self.wall_time + time - self.time


class Segment(NamedTuple):
    """A part of a recording after the first, which begins with the state of the tree.

    Attributes:
        position: The number of recorded steps before it.
        gap: Why steps are missing before it; "" if none is.
        state: The state in which it begins.
    """

    position: int
    gap: str
    state: TreeState


class RunRecording(NamedTuple):
    """The content of a recording.

    Attributes:
        head: The tree.
        steps: The ticks and halts, in order. Those of a run that goes on are a list, which grows.
        segments: The segments after the first, in order.
        damage: Where the file is truncated or damaged, as a sentence; "" if it is complete.
    """

    head: Head
    steps: Sequence[Step]
    segments: tuple[Segment, ...] = ()
    damage: str = ""

    def tick_at(self, index: int) -> Step | None:
        """Return the tick with this index among the steps; for a halt, the tick before it, or None."""
        return next((self.steps[at] for at in range(index, -1, -1) if self.steps[at].tick), None)

    def time_at(self, index: int) -> int:
        """Return the time of `tick_at` (ns since the recording began), or 0."""
        tick = self.tick_at(index)
        return 0 if tick is None else tick.time - self.head.time


def is_external(cls: type[TreeNode]) -> bool:
    """Return whether the results of *cls* are recorded: it is not built in, or a person decides them."""
    module = cls.__module__
    return not module.startswith("btcore.nodes.") or module == "btcore.nodes.manual_selector"
