"""The warning about hooks that other clients left in a robot.

BehaviorTree.CPP's publisher disables all hooks after 5 s without a request. The next request of any client
enables them again, also the requests of a client that only watches, and then a breakpoint stops the tree.
"""

from collections.abc import Callable, Sequence
from typing import Final

from btcore_monitor.watch.address import Address
from btcore_monitor.wire.hooks import WireHook, describe_hook

_MAX_NAMED: Final = 8
_MAX_PATH_CHARS: Final = 120
"""Characters of a path. A hostile robot may send very long names and numbers."""


def hooks_warning(hooks: Sequence[WireHook], path_of: Callable[[int], str], address: Address) -> str:
    """Return the warning about *hooks* of other clients, with the command that removes them.

    Args:
        hooks: The hooks, at least one.
        path_of: Returns the path of the node with a uid.
        address: The robot's address.
    """
    named = ", ".join(describe_hook(hook, path_of(hook.uid)[:_MAX_PATH_CHARS]) for hook in hooks[:_MAX_NAMED])
    more = f" and {len(hooks) - _MAX_NAMED} more" if len(hooks) > _MAX_NAMED else ""
    return (
        f"warning: other clients left hooks in the robot: {named}{more}. A breakpoint stops the tree while a "
        f"client is connected. To remove all hooks: btcore hook {address} clear"
    )
