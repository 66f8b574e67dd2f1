"""ManualSelector: a person chooses the child."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port
from btcore.engine.control import ControlNode
from btcore.engine.node import execute_tick, input_or, set_status
from btcore.engine.node_spec import NodeSpec
from btcore.errors import NodeError
from btcore.escaping import escape_controls
from btcore.status import FAILURE, RUNNING, SUCCESS, Status
from btcore.values import BOOL


@mypyc_attr(allow_interpreted_subclasses=True)
class Prompt:
    """A prompt at the terminal. Subclass it and pass an instance as a resource to ask in another way."""

    def choose(self, question: str, options: list[str]) -> int:
        """Ask the user to choose one of several options.

        Args:
            question: The text of the question.
            options: The texts of the options.

        Returns:
            The index of the chosen option.

        Raises:
            NodeError: The standard input has ended.
        """
        print(escape_controls(question))
        for number, option in enumerate(options, start=1):
            print(f"  {number:2}  {escape_controls(option)}")
        while True:
            try:
                answer = input(f"1–{len(options)}? ").strip()
            except EOFError:
                raise NodeError("no option was chosen: the standard input has ended") from None
            if answer.isdigit() and 1 <= int(answer) <= len(options):
                return int(answer) - 1
            print(f"'{answer}' is not a number from 1 to {len(options)}")


@mypyc_attr(allow_interpreted_subclasses=True)
class ManualSelector(ControlNode):
    """Asks the user which child to tick, or which result to return, in every tick.

    The tick blocks until the user answers. With `repeat_last_selection` the first answer is used for all
    later ticks. The node returns the result of the selected child, or the selected result.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(state_fields=("_last_choice",), formats=(3,))

    _last_choice: int = -1  # the index of a child, or of a result after them; -1 = none
    _prompt: Prompt

    def __init__(self, prompt: Prompt | None = None) -> None:
        self._prompt = Prompt() if prompt is None else prompt

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [Port("repeat_last_selection", type=BOOL, default="false", description="ask only once")]

    def tick(self) -> Status:
        """Ask the user, then tick the chosen child."""
        count = len(self._children)
        if self._last_choice < 0 or input_or(self, "repeat_last_selection", False) is not True:
            set_status(self, RUNNING)
            options = [child.name for child in self._children] + ["SUCCESS", "FAILURE", "RUNNING"]
            question = f"{self.config.path}: which child should be ticked?"
            self._last_choice = self._prompt.choose(question, options)
        if self._last_choice >= count:
            return (SUCCESS, FAILURE, RUNNING)[self._last_choice - count]
        return execute_tick(self._children[self._last_choice])
