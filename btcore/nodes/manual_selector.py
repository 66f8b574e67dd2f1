"""ManualSelector: a person chooses the child."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port
from btcore.engine.control import ControlNode
from btcore.engine.node import execute_tick
from btcore.errors import BlackboardError, ConversionError, NodeError
from btcore.status import (
    FAILURE,
    RUNNING,
    SUCCESS,
    Status,
)
from btcore.values import BOOL


@mypyc_attr(allow_interpreted_subclasses=True)
class Prompt:
    """Asks at the terminal. Subclass it and hand it in as a resource, to ask in another way."""

    def choose(self, question: str, options: list[str]) -> int:
        """The index of the chosen one of *options*. Raises NodeError when nobody can answer."""
        print(question)
        for number, option in enumerate(options, start=1):
            print(f"  {number:2}  {option}")
        while True:
            try:
                answer = input(f"1–{len(options)}? ").strip()
            except EOFError:
                raise NodeError("nobody is there to choose: the input has ended") from None
            if answer.isdigit() and 1 <= int(answer) <= len(options):
                return int(answer) - 1
            print(f"'{answer}' is none of 1–{len(options)}")


@mypyc_attr(allow_interpreted_subclasses=True)
class ManualSelector(ControlNode):
    """Asks a person which child to tick, or which result to give at once.

    With `repeat_last_selection` the first answer holds for all later ticks. The tick waits for the answer.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    state_fields: ClassVar[tuple[str, ...] | None] = ("_last",)

    _last: int = -1
    _prompt: Prompt

    def __init__(self, prompt: Prompt | None = None) -> None:
        self._prompt = Prompt() if prompt is None else prompt

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        return [
            Port("repeat_last_selection", type=BOOL, default="false", description="don't ask a second time")
        ]

    def tick(self) -> Status:
        """Ask, then tick the chosen child."""
        count = len(self._children)
        if self._last < 0 or not self._repeats():
            self.set_status(RUNNING)
            options = [child.name for child in self._children] + ["SUCCESS", "FAILURE", "RUNNING"]
            self._last = self._prompt.choose(f"{self.path}: which child is to be ticked?", options)
        if self._last >= count:
            return (SUCCESS, FAILURE, RUNNING)[self._last - count]
        return execute_tick(self._children[self._last])

    def _repeats(self) -> bool:
        try:
            return self.get_input("repeat_last_selection") is True
        except (NodeError, BlackboardError, ConversionError):
            return False
