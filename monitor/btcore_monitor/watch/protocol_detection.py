"""Detect the protocol of a robot.

Groot 1 and Groot 2 have the same port of requests, 1667. The client sends Groot 2's FULLTREE, a frame of six
bytes: a Groot 2 publisher replies to it, and so does a Groot 1 publisher, which ignores a request's content.
The request must be a single frame: BehaviorTree.CPP 3 (``bt_zmq_publisher.cpp``) receives only the first
frame, and sending a reply while more frames wait is an error of its REP socket that ends its server thread.
"""

from collections.abc import Sequence

from btcore_monitor.watch.address import Address
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.groot1_tree import WireTree, decode_tree


class Groot1DetectedError(ProtocolError):
    """The robot replies in Groot 1's protocol."""


def check_speaks_groot2(frames: Sequence[bytes], address: Address) -> None:
    """Raise an error if a robot replies to a request of Groot 2 in Groot 1's protocol.

    Args:
        frames: The frames of the reply.
        address: The robot's address, for the message.

    Raises:
        Groot1DetectedError: *frames* is a tree in Groot 1's protocol.
    """
    if groot1_tree_in(frames) is not None:
        raise Groot1DetectedError(
            f"{address} uses Groot 1's protocol (BehaviorTree.CPP 3), which supports only the tree and its "
            "statuses"
        )


def groot1_tree_in(frames: Sequence[bytes]) -> WireTree | None:
    """Return the tree in the reply of a Groot 1 publisher, or None if *frames* is another reply."""
    if len(frames) != 1:
        return None
    try:
        tree = decode_tree(frames[0])
    except ProtocolError:
        return None
    return tree if tree.nodes else None
