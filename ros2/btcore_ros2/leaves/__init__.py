"""Leaves that use ROS 2: base classes and decorators, and leaves that need no code."""

from btcore import Registry


def register(nodes: Registry) -> None:
    """Register the leaves that need no code."""
