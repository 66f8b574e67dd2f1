"""Publishing a tree of ours: to Groot 2, to our monitor, to anybody who speaks either."""

from collections.abc import Sequence

from btcore.tree import Tree
from monitor.serve.ports import PortInUse, ServeError
from monitor.serve.publisher import Publisher

__all__ = ["PortInUse", "Publisher", "ServeError", "serve"]


def serve(
    tree: Tree,
    groot2: int | None = 1667,
    bind: str = "127.0.0.1",
    scene: bool = True,
    resources: Sequence[object] = (),
    grace: float = 2.0,
) -> Publisher:
    """Publish *tree* from now on, from a thread of its own; close the result, or use it with ``with``.

    ``with serve(tree): tree.tick_while_running()``

    *groot2* is the port for requests, as Groot 2 knows it; the two after it are taken too
    (notifications, and the scene channel that our monitor prefers). None or 0 takes free ones:
    ``.port`` and ``.address`` tell. *bind* is the interface (``*``: all). Of the *resources*
    those with ``scene_static`` and ``scene_moving`` are shown in 3D, unless *scene* is false.
    *grace* is how long (s, wall clock) closing waits for clients that still catch up.

    The tree never waits for anybody. Raises :class:`PortInUse` or :class:`ServeError`.
    """
    return Publisher(tree, groot2 or 0, bind, scene, resources, grace)
