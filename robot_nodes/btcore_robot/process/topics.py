"""Typed topics: what one process publishes, others hear, each through a queue of its own."""

from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Generic, TypeVar

from btcore_robot.errors import RobotError

Message = TypeVar("Message")


class TopicError(RobotError):
    """A topic is used with two types of messages; the text says which and where."""


class Subscription(Generic[Message]):
    """One listener's queue of at most *depth* messages: when it is full the oldest is lost.

    *wake* is called when there is something to take; *lost* counts what was never taken.
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
        """The process that listens."""
        self.callback = callback
        self.lost = 0
        self._queue: deque[Message] = deque(maxlen=depth)
        self._wake = wake

    def put(self, message: Message) -> None:
        """Take *message* into the queue."""
        self.lost += len(self._queue) == self._queue.maxlen
        self._queue.append(message)
        self._wake()

    def take(self) -> bool:
        """Give the oldest message to the callback; whether there was one."""
        if not self._queue:
            return False
        self.callback(self._queue.popleft())
        return True

    def end(self) -> None:
        """Listen no more; what still waits in the queue is dropped."""
        self._queue.clear()
        if self in self.topic.listeners:
            self.topic.listeners.remove(self)


class Topic(Generic[Message]):
    """A name under which messages of one type go from publishers to listeners."""

    def __init__(self, name: str, type_: type[Message], owner: str) -> None:
        self.name = name
        self.type = type_
        self.owner = owner
        """The process that named it first."""
        self.publishers: list[str] = []
        """The processes that publish on it."""
        self.listeners: list[Subscription[Message]] = []
        self.latched: Message | None = None
        """The last message of a latched publisher, for whoever comes later."""


class Publisher(Generic[Message]):
    """One publisher of a topic. A *latched* one leaves its last message for listeners to come."""

    def __init__(self, topic: Topic[Message], latched: bool) -> None:
        self.topic = topic
        self.latched = latched

    @property
    def has_subscribers(self) -> bool:
        """Whether anybody listens; nobody needs to make a message otherwise."""
        return bool(self.topic.listeners)

    def publish(self, message: Message) -> None:
        """Put *message* into every listener's queue. Raises TopicError for one of another type."""
        topic = self.topic
        if not isinstance(message, topic.type):
            raise TopicError(
                f"{topic.name} takes messages of type {topic.type.__name__}, "
                f"and this is of type {type(message).__name__}"
            )
        if self.latched:
            topic.latched = message
        for listener in list(topic.listeners):
            listener.put(message)


class Topics:
    """All topics of one robot, by name."""

    def __init__(self) -> None:
        self._topics: dict[str, Topic[Any]] = {}

    def names(self) -> list[str]:
        """The names of all topics, sorted."""
        return sorted(self._topics)

    def __iter__(self) -> Iterator[Topic[Any]]:
        """All topics, by name."""
        return (self._topics[name] for name in self.names())

    def topic(self, name: str, type_: type[Message], owner: str) -> Topic[Message]:
        """The topic called *name*, made where there is none; raises TopicError if its type is another."""
        full = full_name(name)
        found = self._topics.get(full)
        if found is None:
            found = self._topics[full] = Topic(full, type_, owner)
        if found.type is not type_:
            raise TopicError(
                f"{owner}: {full} takes messages of type {found.type.__name__} since {found.owner} named it, "
                f"and {type_.__name__} is another type; remap one of the two to another name"
            )
        return found


def full_name(name: str) -> str:
    """*name* with a slash before it: ``scan`` and ``/scan`` are one topic."""
    return name if name.startswith("/") else f"/{name}"
