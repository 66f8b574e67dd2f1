"""The ROS entities of leaves: which leaves use each of them, and the end of those that no leaf uses."""

import gc
import time
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Final
from weakref import WeakSet

from btcore.clock import NS_PER_S

if TYPE_CHECKING:
    from rclpy.callback_groups import CallbackGroup
    from rclpy.node import Node

CHECK_NS: Final = NS_PER_S
"""The time (ns) between two checks for entities without a user."""

SETTLING_NS: Final = NS_PER_S // 10
"""The time (ns) between the creation of a client, or the appearance of its server, and the first message.

The server has to find the client, too: its answer to an earlier message would be lost.
"""


class SharedEntity:
    """An action client, service client, publisher or subscription, and its users.

    Attributes:
        entity: The entity, or an object whose attribute `parts` has the entities of which it consists.
        users: The leaves, and the goals in progress, that use the entity. They are not kept alive.
        is_destroyed: Whether the entity was destroyed.
    """

    def __init__(self, entity: Any) -> None:
        self.entity = entity
        self.users: WeakSet[object] = WeakSet()
        self.is_destroyed = False
        self._unsettled = time.monotonic_ns()  # the creation, or when a server was last missing
        self._was_unused = False

    def add(self, user: object) -> None:
        """Add a user."""
        self.users.add(user)
        self._was_unused = False

    def settling_time(self, *, is_visible: bool) -> int:
        """Return for how long (ns) the first message has to wait, because the server may not know the client.

        Args:
            is_visible: Whether the server is visible.
        """
        now = time.monotonic_ns()
        if not is_visible:
            self._unsettled = now
        return max(0, self._unsettled + SETTLING_NS - now)

    def check_unused(self) -> bool:
        """Return whether there is no user, and was none in the check before."""
        was_unused, self._was_unused = self._was_unused, not self.users
        return was_unused and self._was_unused


class SharedEntities:
    """The entities that the leaves of all trees of a session use.

    An entity stays for one to two seconds after its last user, so that the next tree can use it without
    being discovered again, and so that a last message is delivered.

    Args:
        node: The ROS node of the entities.
    """

    def __init__(self, node: "Node") -> None:
        self._node = node
        self._entities: dict[tuple[Any, ...], SharedEntity] = {}
        self._next_check = 0

    def use(self, user: object, key: tuple[Any, ...], create: Callable[[], Any]) -> SharedEntity:
        """Return the entity for *key*, which *user* uses from now on.

        Args:
            key: What two users with the same entity have in common.
            create: Creates the entity.

        Raises:
            RCLError: The entity cannot be created, for example because its topic is in use with another type.
        """
        from rclpy.impl.implementation_singleton import rclpy_implementation

        shared = self._entities.get(key)
        if shared is None:
            try:
                entity = create()
            except rclpy_implementation.RCLError:
                # The name may have belonged to a leaf with another type, in a tree of the past.
                gc.collect()
                self._destroy([key for key, other in self._entities.items() if not other.users])
                entity = create()
            self._entities[key] = shared = SharedEntity(entity)
        shared.add(user)
        return shared

    def find(self, entity: object) -> SharedEntity | None:
        """Return the record of *entity*; None if it does not belong to leaves."""
        return next((shared for shared in self._entities.values() if shared.entity is entity), None)

    def release(self, users: Iterable[object]) -> None:
        """Forget *users*, for example the nodes of a tree that has ended."""
        gone = list(users)
        for shared in self._entities.values():
            shared.users.difference_update(gone)

    def check(self) -> None:
        """Destroy the entities that have been unused for a second, if it is time to."""
        if (now := time.monotonic_ns()) >= self._next_check:
            self._next_check = now + CHECK_NS
            self._destroy([key for key, shared in self._entities.items() if shared.check_unused()])

    def close(self, group: "CallbackGroup") -> None:
        """Destroy all entities of leaves, and all other entities of the callback group *group*."""
        self._destroy([*self._entities])
        node = self._node
        for entities, destroy in (
            (node.subscriptions, node.destroy_subscription),
            (node.clients, node.destroy_client),
            (node.services, node.destroy_service),
            (node.timers, node.destroy_timer),
            (node.waitables, lambda waitable: waitable.destroy()),
        ):
            for entity in [entity for entity in entities if entity.callback_group is group]:
                destroy(entity)

    def _destroy(self, keys: Iterable[tuple[Any, ...]]) -> None:
        from rclpy.action import ActionClient
        from rclpy.client import Client
        from rclpy.publisher import Publisher

        for key in keys:
            shared = self._entities.pop(key)
            shared.is_destroyed = True
            for entity in getattr(shared.entity, "parts", (shared.entity,)):
                if isinstance(entity, ActionClient):
                    entity.destroy()
                elif isinstance(entity, Client):
                    self._node.destroy_client(entity)
                elif isinstance(entity, Publisher):
                    self._node.destroy_publisher(entity)
                else:
                    self._node.destroy_subscription(entity)
        # rclpy keeps a weak reference to each entity that ever was.
        group = self._node.default_callback_group.entities
        group -= {reference for reference in group if reference() is None}
