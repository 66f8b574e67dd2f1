"""Publishing a tree of ours: to Groot 2 and Groot 1, to our monitor, to anybody who speaks with either."""

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
    """Publish *tree* from now on, from a thread of its own; close the result, or use it with ``with``.

    ``with serve(tree): tree.tick_while_running()``

    *groot2* is the port for requests, as Groot 2 knows it (1667); the two after it are taken too
    (notifications, and the scene channel that our monitor prefers). None or 0 takes free ones:
    ``.port`` and ``.address`` tell. *groot1* is the port where Groot 1 gets updates (usually 1666, and
    2666 beside Groot 2; 0: a free one), and the next one answers its requests; ``.groot1`` tells. With
    *groot1* Groot 2 is served only if *groot2* is a port, and the scene channel is two ports behind
    Groot 1's requests otherwise. *bind* is the interface (``*``: all). Of the *resources* those with
    ``scene_static`` and ``scene_moving`` are shown in 3D, unless *scene* is false. *grace* is how long
    (s, wall clock) closing waits for clients that still catch up.

    With *allow_control* a client may set breakpoints and inject statuses by Groot 2's requests, until none
    has come for *max_heartbeat_delay* (s, wall clock): then hooks are disabled, and a tick that stands goes
    on. At a breakpoint the tree waits for the client; else it never waits for anybody.

    Raises :class:`PortInUseError` or :class:`ServeError`.
    """
    if groot1 is None:
        port: int | None = DEFAULT_PORT if groot2 is ... else groot2 or 0
    else:
        port = None if groot2 is ... else groot2
    control = max_heartbeat_delay if allow_control else None
    return Publisher(tree, port, bind, scene, resources, grace, groot1, control)
