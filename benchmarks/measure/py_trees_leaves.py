"""Leaves of py_trees that read and write its blackboard."""

from py_trees.behaviour import Behaviour
from py_trees.common import Access, Status
from py_trees.composites import Sequence

SUCCESS = Status.SUCCESS


class Reads(Behaviour):
    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.board = self.attach_blackboard_client()
        self.board.register_key("pace", access=Access.READ)

    def update(self) -> Status:
        self.board.pace  # noqa: B018 - reading it is the work
        return SUCCESS


class Writes(Behaviour):
    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.board = self.attach_blackboard_client()
        self.board.register_key("far", access=Access.WRITE)

    def update(self) -> Status:
        self.board.far = 0.5
        return SUCCESS


class Prepares(Behaviour):
    """Gives the entries their first values."""

    def __init__(self) -> None:
        super().__init__("prepares")
        board = self.attach_blackboard_client()
        board.register_key("pace", access=Access.WRITE)
        board.pace = 0.5

    def update(self) -> Status:
        return SUCCESS


def grow(leaf: type[Behaviour], width: int) -> Behaviour:
    """A Sequence of *width* such leaves."""
    Prepares()
    return Sequence("wide", memory=True, children=[leaf(f"{number}") for number in range(width)])
