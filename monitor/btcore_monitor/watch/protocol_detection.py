"""Finding out which protocol a robot speaks.

Groot 1's and Groot 2's requests arrive at the same port, 1667. The question is Groot 2's FULLTREE, one
frame of six bytes: a Groot 2 publisher answers it, and so does a Groot 1 publisher, which doesn't look at
what it is asked. It has to be one frame: BehaviorTree.CPP 3 takes in the first one only, and its thread
ends when it answers a request that goes on.
"""

from collections.abc import Sequence

from btcore_monitor.watch.address import Address
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.groot1_tree import WireTree, decode_tree


class Groot1DetectedError(ProtocolError):
    """The robot answers, and it does so in Groot 1's protocol."""


def check_speaks_groot2(frames: Sequence[bytes], address: Address) -> None:
    """Raise Groot1DetectedError if *frames*, the reply to a Groot 2 request, is a tree of Groot 1's."""
    if groot1_tree_in(frames) is not None:
        raise Groot1DetectedError(
            f"{address} speaks Groot 1's protocol (BehaviorTree.CPP 3), which shows the tree and its "
            "statuses, and knows no other request"
        )


def groot1_tree_in(frames: Sequence[bytes]) -> WireTree | None:
    """The tree that a Groot 1 publisher answered with; None if *frames* is anything else."""
    if len(frames) != 1:
        return None
    try:
        tree = decode_tree(frames[0])
    except ProtocolError:
        return None
    return tree if tree.nodes else None
