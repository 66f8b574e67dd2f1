"""A server of Groot 1's protocol. It converts transitions to updates, and sends the tree on request."""

from collections.abc import Iterator
from typing import Final

import zmq

from btcore.blackboard.ports import Direction, Port
from btcore.engine.node_config import MAX_NODES
from btcore.registry.manifest import Manifest
from btcore.status import NodeType
from btcore.tree.tree import Tree
from btcore_monitor.serve.queueing_observer import TransitionItem
from btcore_monitor.serve.request_socket import RequestSocket
from btcore_monitor.serve.tcp_ports import Socket
from btcore_monitor.wire import groot1
from btcore_monitor.wire.groot1 import WireTransition
from btcore_monitor.wire.groot1_tree import (
    INOUT,
    INPUT,
    OUTPUT,
    WireModel,
    WireNode,
    WirePort,
    WireTree,
    encode_tree,
    status_places,
)

_UNTYPED: Final = "void"
_MAX_REQUEST_BYTES: Final = 4 << 10
"""Maximum bytes of a request, whose content is ignored, or of a subscription."""
_MAX_UPDATES: Final = 250
"""Maximum queued updates of a slow client, about ten seconds; the client misses further updates."""

_DIRECTIONS: Final = {Direction.IN: INPUT, Direction.OUT: OUTPUT, Direction.INOUT: INOUT}


class Groot1Server:
    """Serves one tree. Only the publisher's thread may use it.

    Args:
        tree: The tree to serve.
        offset: The uids on the wire start at this number plus 1. Groot 1 has no tree IDs and detects a new
            tree only by unknown uids, so each tree of a robot gets new uids.
        rate: Maximum updates per second.
        ending: Bytes after the tree in each reply.
    """

    def __init__(self, tree: Tree, offset: int = 0, rate: float = groot1.RATE, ending: bytes = b"") -> None:
        # A uid has 16 bits on the wire; the numbers start again when there are not enough left.
        self.offset = offset if offset + len(tree.nodes) <= MAX_NODES else 0
        self.end = self.offset + len(tree.nodes)
        """The last uid on the wire."""
        self._period = 1 / rate
        self._statuses = {
            self.offset + node.config.uid: groot1.status_code(int(node._status)) for node in tree.nodes
        }
        # The statuses at the last update; the next update begins with them.
        self._before = dict(self._statuses)
        self._tree = bytearray(
            encode_tree(WireTree(tuple(self._create_wire_nodes(tree)), _create_wire_models(tree))) + ending
        )
        self._places = dict(zip(self._statuses, status_places(bytes(self._tree)), strict=True))
        self._waiting: list[WireTransition] = []
        self._due = 0.0

    def add_transition(self, item: TransitionItem, now: float) -> None:
        """Add a transition to the next update.

        Args:
            item: The transition, with its wall-clock time.
            now: The time in s of any monotonic clock.
        """
        self._add_transition(item.transition.uid, int(item.transition.status), item.wall, now)

    def correct_statuses(self, statuses: dict[int, int], wall: int, now: float) -> None:
        """Correct nodes with lost transitions by adding transitions to their current statuses.

        Args:
            statuses: The tree's current statuses by uid.
            wall: The wall clock, ns since the epoch.
            now: The time in s of any monotonic clock.
        """
        for node, status in statuses.items():
            self._add_transition(node, status, wall, now)

    def _add_transition(self, node: int, status: int, wall: int, now: float) -> None:
        uid, status = self.offset + node, groot1.status_code(status)
        previous = self._statuses[uid]
        if status == previous:
            return
        # Changes wait for at most one period, and are published with all changes until then.
        if not self._waiting:
            self._due = now + self._period
        self._waiting.append(WireTransition(wall, uid, previous, status))
        self._statuses[uid] = status
        self._tree[self._places[uid]] = status

    def update(self, now: float, at_once: bool = False) -> bytes | None:
        """Return the next update's frame, or None if there is nothing to publish at *now*.

        Args:
            now: The time in s of any monotonic clock.
            at_once: Whether to ignore the maximum rate.
        """
        if not self._waiting or (now < self._due and not at_once):
            return None
        frame = groot1.encode_update(self._before.items(), self._waiting)
        self._before = dict(self._statuses)
        self._waiting = []
        return frame

    def answer(self) -> bytes:
        """Return the tree with its nodes' current statuses, the reply to every request.

        BehaviorTree.CPP 3 replies with the statuses at the start: its `bt_zmq_publisher.cpp` encodes the
        tree once. Groot 1 shows these statuses until the first update.
        """
        return bytes(self._tree)

    def _create_wire_nodes(self, tree: Tree) -> Iterator[WireNode]:
        instances = {part.path: part.id for part in tree.subtrees}
        for node in tree.nodes:
            uid = self.offset + node.config.uid
            children = tuple(self.offset + child.config.uid for child in node.children)
            if node.spec.node_type is NodeType.SUBTREE:
                # As in BehaviorTree.CPP 3: a SubTree node has its tree's ID as name, and no ports.
                yield WireNode(
                    uid, children, self._statuses[uid], instances[node.config.path], node.config.id
                )
                continue
            config = node.config
            ports = [(name, port.text) for name, port in config.inputs.items()]
            ports += [(name, port.text) for name, port in config.outputs.items()]
            yield WireNode(uid, children, self._statuses[uid], node.name, node.config.id, tuple(ports))


def _create_wire_models(tree: Tree) -> tuple[WireModel, ...]:
    """Return the models of all registered nodes, and of other nodes in the tree."""
    manifests = tree.registry.manifests_of(tree.format)
    # BehaviorTree.CPP 3.8 does not list the old spelling of RetryUntilSuccessful.
    models = {
        id: _create_wire_model(manifest) for id, manifest in manifests.items() if id != "RetryUntilSuccesful"
    }
    for node in tree.nodes:
        # Groot 1 looks up every node's model without a check, and crashes if it is missing.
        if node.config.id not in models:
            models[node.config.id] = WireModel(node.config.id, int(node.spec.node_type))
    return tuple(models.values())


def _create_wire_model(manifest: Manifest) -> WireModel:
    ports = (
        () if manifest.type is NodeType.SUBTREE else tuple(map(_create_wire_port, manifest.ports.values()))
    )
    return WireModel(manifest.id, int(manifest.type), ports)


def _create_wire_port(port: Port) -> WirePort:
    type_name = port.type.name if port.type.strong else _UNTYPED
    return WirePort(port.name, _DIRECTIONS[port.direction], type_name, port.description)


class Groot1Sockets:
    """The sockets of a `Groot1Server`: *updates* and *requests*."""

    def __init__(self, context: "zmq.Context[Socket]") -> None:
        self.updates = context.socket(zmq.PUB)
        self.requests = RequestSocket(context, _MAX_REQUEST_BYTES)
        self.updates.setsockopt(zmq.SNDHWM, _MAX_UPDATES)
        self.updates.setsockopt(zmq.MAXMSGSIZE, _MAX_REQUEST_BYTES)
        self.updates.setsockopt(zmq.LINGER, 0)

    def publish(self, server: Groot1Server, now: float, at_once: bool = False) -> None:
        """Send the next update, if it is due.

        Args:
            server: The server that makes the update.
            now: The time in s of any monotonic clock.
            at_once: Whether to ignore the maximum rate.
        """
        frame = server.update(now, at_once)
        if frame is not None:
            self.updates.send(frame, zmq.DONTWAIT)

    def answer(self, server: Groot1Server) -> None:
        """Receive a request, if there is any, and send the reply of *server*."""
        if self.requests.receive() is not None:
            self.requests.answer([server.answer()])

    def close(self, linger: int = 0) -> None:
        """Close the sockets. Queued messages get *linger* ms to be sent."""
        self.updates.close(linger=linger)
        self.requests.socket.close(linger=linger)
