"""Publish a running tree for Groot 2, Groot 1, btcore's monitor, and any other client of their protocols."""

from collections.abc import Sequence
from types import EllipsisType

from btcore.tree.tree import Tree
from btcore_monitor.serve.hook_controller import MAX_HEARTBEAT_DELAY
from btcore_monitor.serve.publisher import Publisher
from btcore_monitor.serve.tcp_ports import PortInUseError, ServeError
from btcore_monitor.wire.groot2 import DEFAULT_PORT

__all__ = ["PortInUseError", "Publisher", "ServeError", "serve"]


def serve(
    tree: Tree,
    groot2: int | EllipsisType | None = ...,
    bind: str = "127.0.0.1",
    scene: bool = True,
    resources: Sequence[object] = (),
    grace: float = 2.0,
    *,
    groot1: int | None = None,
    allow_control: bool = False,
    max_heartbeat_delay: float = MAX_HEARTBEAT_DELAY,
) -> Publisher:
    """Publish *tree* from a separate thread until the returned publisher is closed.

    The publisher is a context manager: ``with serve(tree): tree.tick_while_running()``. The tree waits for a
    client only at a breakpoint, which *allow_control* permits.

    Args:
        tree: The tree to publish.
        groot2: The port for Groot 2's requests (1667 by default). The next two ports are used for
            notifications and for the scene channel, which btcore's monitor prefers. None or 0 chooses free
            ports; see `Publisher.port` and `Publisher.address`. With *groot1*, Groot 2 is served only if
            this is a port number.
        bind: The interface (``*``: all interfaces).
        scene: Whether to publish the scene channel.
        resources: Objects of the robot. Those with ``scene_static`` and ``scene_moving`` are shown in 3D.
        grace: Maximum time in s (wall clock) that closing waits for clients that still read.
        groot1: The port for Groot 1's updates: usually 1666, or 2666 if Groot 2 is served too. 0 chooses a
            free port; see `Publisher.groot1`. The next port answers requests. Without Groot 2, the scene
            channel is two ports above these requests.
        allow_control: Whether clients may set breakpoints and inject statuses by Groot 2's requests.
        max_heartbeat_delay: Time in s (wall clock) without a request after which hooks are disabled and a
            tick that waits at a breakpoint continues.

    Raises:
        PortInUseError: Another program uses a port.
        ServeError: The ports or the interface are invalid.
    """
    if groot1 is None:
        port: int | None = DEFAULT_PORT if groot2 is ... else groot2 or 0
    else:
        port = None if groot2 is ... else groot2
    control = max_heartbeat_delay if allow_control else None
    return Publisher(tree, port, bind, scene, resources, grace, groot1, control)
