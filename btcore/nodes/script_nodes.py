"""Nodes that run a script: Script, ScriptCondition and Precondition."""

from collections.abc import Mapping
from typing import ClassVar, cast

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port, PortRole
from btcore.engine.control import DecoratorNode
from btcore.engine.leaf import Condition, SyncAction
from btcore.engine.node import TreeNode, execute_tick, reset_status
from btcore.engine.node_spec import NodeSpec
from btcore.errors import NodeError
from btcore.script.program import Program, compile_script, condition_result
from btcore.status import ANY_RESULT, FAILURE, RUNNING, SUCCESS, PossibleResults, Status
from btcore.values import ANY, NODE_STATUS, STRING


class PortScript:
    """The script in an input port: compiled when the tree is loaded, and again when its text changes.

    As in BehaviorTree.CPP, a script that is empty from the start is not an error of loading; a text that
    becomes empty later is an error of the tick.
    """

    def __init__(self, node: TreeNode, port: str) -> None:
        self.node = node
        self.port = port
        self.text = ""
        self.program: Program | None = None
        self.load()

    def load(self) -> Program | None:
        """Return the program of the port's current text, compiled if the text has changed; None = no script.

        Raises:
            NodeError: The port is missing.
            BlackboardError: The port cannot be read.
            ScriptError: The text is not a valid script.
        """
        text = str(self.node.get_input(self.port))
        program = self.program
        if text != self.text:
            program = compile_script(text, self.node.config.enums)
            self.program = program
            self.text = text
        return program

    def run_condition(self, program: Program | None) -> bool:
        """Run *program* on the node's blackboard, and return its result. Raise NodeError if it is None."""
        if program is None:
            raise NodeError(f"port [{self.port}] has an empty script: write a condition, such as a > 1")
        return condition_result(program.run(self.node._blackboard))


@mypyc_attr(allow_interpreted_subclasses=True)
class Script(SyncAction):
    """Runs the script `code` on the node's blackboard, and succeeds. An empty `code` has no effect."""

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="§", results=frozenset({SUCCESS}), formats=(4,))

    _script: PortScript

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [Port("code", type=STRING, description="the script", role=PortRole.SCRIPT)]

    def prepare(self) -> None:
        """Compile the script."""
        self._script = PortScript(self, "code")

    def tick(self) -> Status:
        """Run the script."""
        program = self._script.load()
        if program is not None:
            program.run(self._blackboard)
        return SUCCESS


@mypyc_attr(allow_interpreted_subclasses=True)
class ScriptCondition(Condition):
    """Runs the script `code` on the node's blackboard; succeeds if its value is true, else fails."""

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="§", results=frozenset({SUCCESS, FAILURE}), formats=(4,))

    _script: PortScript

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        about = "the script, whose value is true or false"
        return [Port("code", type=ANY, description=about, role=PortRole.CONDITION)]

    def prepare(self) -> None:
        """Compile the script."""
        self._script = PortScript(self, "code")

    def tick(self) -> Status:
        """Run the script."""
        script = self._script
        return SUCCESS if script.run_condition(script.load()) else FAILURE


@mypyc_attr(allow_interpreted_subclasses=True)
class Precondition(DecoratorNode):
    """Ticks its child if the value of the script `if` is true, else returns `else` (default FAILURE).

    After the script was true, it is not run again until the child completes, even after a halt or a skipped
    child, as in BehaviorTree.CPP 4.10. Both ports are read in every tick.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(state_fields=("_child_started",), formats=(4,))

    _script: PortScript
    _child_started: bool = False  # whether the script was true, and the child has not completed since

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the child's results and the status in the port `else`."""
        child, otherwise = children[0], literals.get("else")
        refused = frozenset({otherwise}) & ANY_RESULT if isinstance(otherwise, Status) else ANY_RESULT
        may_run = child.may_run or not isinstance(otherwise, Status) or otherwise is RUNNING
        return PossibleResults(child.in_first_tick | refused, child.after_running | refused, may_run)

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [
            Port("if", type=STRING, description="the script that decides", role=PortRole.CONDITION),
            Port("else", type=NODE_STATUS, default="FAILURE", description="the result if it is false"),
        ]

    def prepare(self) -> None:
        """Compile the script."""
        self._script = PortScript(self, "if")

    def tick(self) -> Status:
        """Run the script, then tick the child."""
        # BehaviorTree.CPP reads both ports in every tick: an invalid port raises even if it is not used.
        program = self._script.load()
        otherwise = cast(Status, self.get_input("else"))
        # A halt does not reset _child_started: BehaviorTree.CPP does not override halt() here either.
        if not self._child_started:
            self._child_started = self._script.run_condition(program)
            if not self._child_started:
                return otherwise
        status = execute_tick(self.child)
        if status is SUCCESS or status is FAILURE:
            self._child_started = False
            reset_status(self.child)
        return status
