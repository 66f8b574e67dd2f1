"""Typed topics: each subscription has its own queue of published messages."""

from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Generic, TypeVar

from btcore_robot.errors import RobotError

Message = TypeVar("Message")


class TopicError(RobotError):
    """A topic is used with two types of messages; the message names the topic and the types."""


class Subscription(Generic[Message]):
    """A queue of at most *depth* messages for a callback. When it is full, the oldest message is dropped.

    *wake* is called when a message arrives.

    Attributes:
        topic: The topic.
        callback: The function that is called with each message.
        owner: The name of the component with the callback, for error messages.
        lost: The number of dropped messages.
    """

    def __init__(
        self,
        topic: "Topic[Message]",
        callback: Callable[[Message], None],
        depth: int,
        wake: Callable[[], None],
        owner: str,
    ) -> None:
        self.topic = topic
        self.owner = owner
        self.callback = callback
        self.lost = 0
        self._queue: deque[Message] = deque(maxlen=depth)
        self._wake = wake

    def put(self, message: Message) -> None:
        """Add *message* to the queue."""
        # A full deque drops its oldest item when another is appended.
        self.lost += len(self._queue) == self._queue.maxlen
        self._queue.append(message)
        self._wake()

    def take(self) -> bool:
        """Call the callback with the oldest message; return False if the queue is empty."""
        if not self._queue:
            return False
        self.callback(self._queue.popleft())
        return True

    def destroy(self) -> None:
        """Remove the subscription from its topic and drop the messages in the queue."""
        self._queue.clear()
        if self in self.topic.subscriptions:
            self.topic.subscriptions.remove(self)


class Topic(Generic[Message]):
    """A named channel for messages of a single type, from publishers to subscriptions.

    Args:
        type_: The class of the messages.

    Attributes:
        name: The name.
        type: The class of the messages.
        owner: The name of the component that used the topic first, for error messages.
        publishers: The names of the components that publish on the topic.
        subscriptions: The subscriptions.
        latched: The last message of a latched publisher, for later subscriptions; None if there is none.
    """

    def __init__(self, name: str, type_: type[Message], owner: str) -> None:
        self.name = name
        self.type = type_
        self.owner = owner
        self.publishers: list[str] = []
        self.subscriptions: list[Subscription[Message]] = []
        self.latched: Message | None = None


class Publisher(Generic[Message]):
    """A publisher on a topic.

    Attributes:
        topic: The topic.
        latched: Whether the last message is kept for later subscriptions.
    """

    def __init__(self, topic: Topic[Message], latched: bool) -> None:
        self.topic = topic
        self.latched = latched

    @property
    def has_subscribers(self) -> bool:
        """Whether the topic has subscriptions. A publisher may omit expensive messages otherwise."""
        return bool(self.topic.subscriptions)

    def publish(self, message: Message) -> None:
        """Add *message* to the queue of every subscription.

        Raises:
            TopicError: The message is not of the topic's type.
        """
        topic = self.topic
        if not isinstance(message, topic.type):
            raise TopicError(
                f"{topic.name} has messages of type {topic.type.__name__}, "
                f"not of type {type(message).__name__}"
            )
        if self.latched:
            topic.latched = message
        # A copy, because waking a subscriber may create or destroy subscriptions.
        for subscription in list(topic.subscriptions):
            subscription.put(message)


class Topics:
    """All topics of one robot, by name."""

    def __init__(self) -> None:
        self._topics: dict[str, Topic[Any]] = {}

    def names(self) -> list[str]:
        """Return the names of all topics, sorted."""
        return sorted(self._topics)

    def __iter__(self) -> Iterator[Topic[Any]]:
        """Iterate over all topics, sorted by name."""
        return (self._topics[name] for name in self.names())

    def topic(self, name: str, type_: type[Message], owner: str) -> Topic[Message]:
        """Return the topic *name*, and create it if it does not exist.

        Args:
            name: The name, with or without a leading slash.
            type_: The class of the messages.
            owner: The name of the component that uses the topic.

        Raises:
            TopicError: The topic exists with another type.
        """
        full = full_name(name)
        topic = self._topics.get(full)
        if topic is None:
            topic = self._topics[full] = Topic(full, type_, owner)
        if topic.type is not type_:
            raise TopicError(
                f"{owner}: {full} has messages of type {topic.type.__name__}, which {topic.owner} declared, "
                f"not of type {type_.__name__}; remap either topic to another name"
            )
        return topic


def full_name(name: str) -> str:
    """Return *name* with a leading slash: `scan` and `/scan` are the same topic."""
    return name if name.startswith("/") else f"/{name}"
