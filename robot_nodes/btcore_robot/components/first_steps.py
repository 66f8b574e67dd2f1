"""First programs: a logger, a publisher, a subscriber, and a component with parameters.

They are from chapter 2 of the book *A Concise Introduction to Robot Programming with ROS2*.
"""

from dataclasses import dataclass

from btcore_robot.components.component import Component, ComponentContext, ComponentOptions

PERIOD_S = 0.5
"""The period (s) of the logger and the publisher."""


@dataclass(frozen=True, slots=True)
class Int32:
    """A message with a whole number, as `std_msgs/Int32`.

    Attributes:
        data: The number.
    """

    data: int


class Logger(Component):
    """Log `Hello N` twice a second, with N from 0."""

    def __init__(self, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        super().__init__("logger_node", context, options)
        self.counter = 0
        self.create_timer(PERIOD_S, self.log)

    def log(self) -> None:
        """Log the message and increment the counter."""
        self.info(f"Hello {self.counter}")
        self.counter += 1


class NumberPublisher(Component):
    """Publish 1, 2, 3 … on `int_topic`, twice a second."""

    def __init__(self, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        super().__init__("publisher_node", context, options)
        self.message = Int32(0)
        self.numbers = self.create_publisher("int_topic", Int32)
        self.create_timer(PERIOD_S, self.publish)

    def publish(self) -> None:
        """Increment the number and publish it: the first number is 1."""
        self.message = Int32(self.message.data + 1)
        self.numbers.publish(self.message)


class NumberSubscriber(Component):
    """Log `Hello N` for each number received on `int_topic`."""

    def __init__(self, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        super().__init__("subscriber_node", context, options)
        self.create_subscription("int_topic", Int32, self.on_number)

    def on_number(self, message: Int32) -> None:
        """Log the number."""
        self.info(f"Hello {message.data}")


class Localization(Component):
    """Declare parameters and log them, or log an error if `topics` and `topic_types` differ in length."""

    def __init__(self, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        super().__init__("localization_node", context, options)
        declare = self.parameters.declare
        self.number_particles = declare("number_particles", 200)
        no_names: list[str] = []
        self.topics = declare("topics", no_names)
        self.topic_types = declare("topic_types", list(no_names))
        if len(self.topics) != len(self.topic_types):
            self.error(f"Number of topics ({len(self.topics)}) != number of types ({len(self.topic_types)})")
            return
        self.info(f"Number of particles: {self.number_particles}")
        for topic, topic_type in zip(self.topics, self.topic_types, strict=True):
            self.info(f"{topic}: {topic_type}")
