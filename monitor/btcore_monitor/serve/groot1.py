"""Our tree speaks Groot 1's protocol: transitions in, updates and the tree out, and the two sockets."""

from collections.abc import Iterator
from typing import Final

import zmq

from btcore.blackboard.ports import Direction, Port
from btcore.registry.manifest import Manifest
from btcore.status import NodeType
from btcore.tree.tree import MAX_NODES, Tree
from btcore_monitor.serve.queueing_observer import StampedTransition
from btcore_monitor.serve.request_socket import RequestSocket
from btcore_monitor.serve.tcp_ports import Socket
from btcore_monitor.wire import groot1
from btcore_monitor.wire.groot1 import WireChange
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
_REQUEST_AT_MOST: Final = 1 << 20
_UPDATES_AT_MOST: Final = 250
"""Updates that wait for one slow client, some ten seconds of them; what it misses beyond is gone."""

_DIRECTIONS: Final = {Direction.IN: INPUT, Direction.OUT: OUTPUT, Direction.INOUT: INOUT}


class Groot1Server:
    """Speaks for one tree. Belongs to the publisher's thread.

    The uids on the wire begin behind *offset*: Groot 1 tells by unknown uids alone that there is another
    tree. *rate* is how many updates are made a second, at most.
    """

    def __init__(self, tree: Tree, offset: int = 0, rate: float = groot1.RATE) -> None:
        self.offset = offset if offset + len(tree.nodes) <= MAX_NODES else 0
        self.end = self.offset + len(tree.nodes)
        """The last uid on the wire."""
        self._period = 1 / rate
        self._statuses = {self.offset + node.uid: groot1.status_code(int(node.status)) for node in tree.nodes}
        # As they were at the last update, which is what the next one begins with.
        self._before = dict(self._statuses)
        self._tree = bytearray(encode_tree(WireTree(tuple(self._nodes(tree)), _models(tree))))
        self._places = dict(zip(self._statuses, status_places(bytes(self._tree)), strict=True))
        self._waiting: list[WireChange] = []
        self._due = 0.0

    def add_transition(self, item: StampedTransition, now: float) -> None:
        """Take a transition in, at *now* (s, any clock that doesn't go back)."""
        self._change(item.change.uid, int(item.change.status), item.wall, now)

    def correct(self, statuses: dict[int, int], wall: int, now: float) -> None:
        """Let nodes change, of whose transitions some were lost, to what the tree says itself."""
        for node, status in statuses.items():
            self._change(node, status, wall, now)

    def _change(self, node: int, status: int, wall: int, now: float) -> None:
        uid, status = self.offset + node, groot1.status_code(status)
        previous = self._statuses[uid]
        if status == previous:
            return
        if not self._waiting:
            self._due = now + self._period
        self._waiting.append(WireChange(wall, uid, previous, status))
        self._statuses[uid] = status
        self._tree[self._places[uid]] = status

    def update(self, now: float, at_once: bool = False) -> bytes | None:
        """What is to be published at *now*, if anything is; *at_once* doesn't wait for its time."""
        if not self._waiting or (now < self._due and not at_once):
            return None
        frame = groot1.encode_update(self._before.items(), self._waiting)
        self._before = dict(self._statuses)
        self._waiting = []
        return frame

    def answer(self) -> bytes:
        """The tree, and how its nodes stand now; the answer to any request.

        BehaviorTree.CPP answers with how they stood at the start, which Groot 1 then shows.
        """
        return bytes(self._tree)

    def _nodes(self, tree: Tree) -> Iterator[WireNode]:
        instances = {part.path: part.id for part in tree.subtrees}
        for node in tree.nodes:
            uid = self.offset + node.uid
            children = tuple(self.offset + one.uid for one in node.children)
            if node.type is NodeType.SUBTREE:
                # As the original has it: it goes by its tree's ID, and has no ports.
                yield WireNode(uid, children, self._statuses[uid], instances[node.path], node.id)
                continue
            config = node.config
            ports = [(name, port.text) for name, port in config.inputs.items()]
            ports += [(name, port.text) for name, port in config.outputs.items()]
            yield WireNode(uid, children, self._statuses[uid], node.name, node.id, tuple(ports))


def _models(tree: Tree) -> tuple[WireModel, ...]:
    """The models of all that the tree's registry has, and of what else the tree is made of."""
    models = {id: _model(one) for id, one in tree.registry.manifests_of(tree.format).items()}
    for node in tree.nodes:
        # Groot 1 looks up every node's model, and ends where there is none.
        if node.id not in models:
            models[node.id] = WireModel(node.id, int(node.type))
    return tuple(models.values())


def _model(manifest: Manifest) -> WireModel:
    ports = () if manifest.type is NodeType.SUBTREE else tuple(map(_port, manifest.ports.values()))
    return WireModel(manifest.id, int(manifest.type), ports)


def _port(port: Port) -> WirePort:
    kind = port.type.name if port.type.strong else _UNTYPED
    return WirePort(port.name, _DIRECTIONS[port.direction], kind, port.description)


class Groot1Sockets:
    """The sockets for a :class:`Groot1Server`: of updates, and of requests."""

    def __init__(self, context: "zmq.Context[Socket]") -> None:
        self.updates = context.socket(zmq.PUB)
        self.requests = RequestSocket(context, _REQUEST_AT_MOST)
        self.updates.setsockopt(zmq.SNDHWM, _UPDATES_AT_MOST)
        self.updates.setsockopt(zmq.MAXMSGSIZE, _REQUEST_AT_MOST)
        self.updates.setsockopt(zmq.LINGER, 0)

    def publish(self, server: Groot1Server, now: float, at_once: bool = False) -> None:
        """Send what is to be sent at *now*, as :meth:`Groot1Server.update` says."""
        frame = server.update(now, at_once)
        if frame is not None:
            self.updates.send(frame, zmq.DONTWAIT)

    def answer(self, server: Groot1Server) -> None:
        """Take the request in that has come, and answer it."""
        if self.requests.take() is not None:
            self.requests.answer([server.answer()])

    def close(self, linger: int = 0) -> None:
        """Free them; what is on its way has *linger* ms."""
        self.updates.close(linger=linger)
        self.requests.socket.close(linger=linger)
