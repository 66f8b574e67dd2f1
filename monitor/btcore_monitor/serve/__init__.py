"""Publish a running tree for Groot 2, Groot 1, btcore's monitor, and any other client of their protocols."""

import ipaddress
import logging
from collections.abc import Sequence
from typing import Final

from btcore.tree.tree import Tree
from btcore_monitor.keys import RobotKeys
from btcore_monitor.serve.hook_controller import MAX_HEARTBEAT_DELAY_S
from btcore_monitor.serve.publisher import Publisher
from btcore_monitor.serve.publisher_sockets import PublisherSockets
from btcore_monitor.serve.tcp_ports import PortInUseError, ServeError
from btcore_monitor.time_limits import GRACE_S
from btcore_monitor.wire.groot2 import DEFAULT_PORT

__all__ = ["PortInUseError", "Publisher", "ServeError", "serve"]

_LOOPBACK_NAMES: Final = {"localhost", "lo", "lo0"}

_log = logging.getLogger("monitor")


def serve(
    tree: Tree,
    *,
    # what is published
    resources: Sequence[object] = (),
    run_channel: bool = True,
    grace: float = GRACE_S,
    # where
    groot2_port: int | None = DEFAULT_PORT,
    groot1_port: int | None = None,
    watch_port: int | None = None,
    bind: str = "127.0.0.1",
    # for whom
    keys: RobotKeys | None = None,
    allow_control: bool = False,
    allow_changes: bool = False,
    insecure: bool = False,
    max_heartbeat_delay: float = MAX_HEARTBEAT_DELAY_S,
) -> Publisher:
    """Publish *tree* from a separate thread until the returned publisher is closed.

    The publisher is a context manager: `with serve(tree): tree.tick_while_running()`. The tree waits for a
    client only at a breakpoint, which *allow_control* permits.

    Without *keys*, every program that reaches the ports can watch the tree. A *bind* to another interface
    than the loopback interface then logs a warning.

    Args:
        tree: The tree to publish.
        resources: Objects of the robot. Those with `static_scene` and `moving_scene` are shown in 3D.
        run_channel: Whether to publish the run channel.
        grace: Maximum time in s (wall clock) that closing waits for clients that have not received the end of
            the run yet. After an exception or Ctrl-C it waits for 2 s at most.
        groot2_port: The port for Groot 2's requests. The next two ports are used for notifications and for
            the run channel, which btcore's monitor prefers. 0 chooses free ports; see `Publisher.port` and
            `Publisher.address`. None: Groot 2 is not served.
        groot1_port: The port for Groot 1's updates: usually 1666, or 2666 if Groot 2 is served too. 0 chooses
            a free port; see `Publisher.groot1_port`. The next port answers requests. Without Groot 2, the run
            channel is two ports above these requests. None: Groot 1 is not served.
        watch_port: The first of further ports for clients without keys, such as Groot. These clients can
            watch, but not control the tree. Only with *keys*. 0 chooses free ports; see
            `Publisher.watch_address`.
        bind: The interface (`*`: all interfaces).
        keys: Encrypt all connections, and accept only clients with these public keys.
        allow_control: Whether clients may set breakpoints and inject statuses by Groot 2's requests.
        allow_changes: Whether clients may also set entries of blackboards and, in `btcore run`, reload the
            tree. On other interfaces than loopback only with *keys*, even if *insecure*.
        insecure: Whether *allow_control* is permitted without *keys* on other interfaces than loopback.
        max_heartbeat_delay: Time in s (wall clock) after which hooks are disabled and a tick that waits at a
            breakpoint continues, if the clients that set or released breakpoints send no request.

    Raises:
        PortInUseError: Another program uses a port.
        ServeError: The ports or the interface are invalid, or the tree could be controlled over the network
            without keys.

    Examples:
        >>> import btcore
        >>> from btcore_monitor.serve import serve
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Sleep(msec=20))
        >>> with serve(tree, groot2_port=0) as publisher:
        ...     tree.tick_while_running()
        <Status.SUCCESS: 2>
        >>> publisher.address.startswith("tcp://127.0.0.1:")
        True
    """
    if watch_port is not None and keys is None:
        raise ServeError("a port for watching without keys has no effect, because there are no keys")
    if keys is None and not is_loopback(bind):
        if allow_changes:
            raise ServeError(
                f"changes from the network ('{bind}') need keys: use --key-file and --allow-key, or serve(…, "
                "keys=RobotKeys(…))"
            )
        _check_exposure(bind, allow_control, insecure)
    if groot2_port is None and groot1_port is None:
        raise ServeError("there is nothing to serve: groot2_port and groot1_port are None")
    sockets = PublisherSockets(groot2_port, groot1_port, bind, run_channel, keys, watch_port)
    try:
        hook_delay = max_heartbeat_delay if allow_control else None
        return Publisher(tree, sockets, resources, grace, hook_delay, allow_changes)
    except BaseException:
        sockets.close()
        raise


def is_loopback(bind: str) -> bool:
    """Return whether only programs on this machine can connect to the interface *bind*."""
    try:
        return ipaddress.ip_address(bind.strip("[]")).is_loopback
    except ValueError:
        return bind in _LOOPBACK_NAMES


def _check_exposure(bind: str, allow_control: bool, insecure: bool) -> None:
    if allow_control and not insecure:
        raise ServeError(
            f"control from the network ('{bind}') needs keys: use --key-file and --allow-key, or serve(…, "
            "keys=RobotKeys(…)); --insecure lets every program that reaches the port stop the robot"
        )
    verb = "control" if allow_control else "watch"
    _log.warning(
        "published at '%s' without keys: every program that reaches the port can %s the tree, and the "
        "connections are not encrypted; see --key-file",
        bind,
        verb,
    )
