"""The exceptions of the engine."""

from collections.abc import Iterable
from typing import Final

from btcore.diagnostics import Diagnostic, excerpt, shown_diagnostics


class BtcoreError(Exception):
    """The base class of the errors that the engine raises.

    Examples:
        >>> import btcore
        >>> try:
        ...     btcore.load("missing.xml")
        ... except btcore.BtcoreError as error:
        ...     print(type(error).__name__)
        TreeError
    """


class TreeError(BtcoreError):
    """No tree can be loaded from the document.

    *diagnostics* holds the errors of reading and planning or, if there are none, those of creating the nodes.
    The message shows the first 100 of each file.

    Examples:
        >>> import btcore
        >>> b = btcore.Builder()
        >>> try:
        ...     b.build(b.Sequence(b.Inverter()))
        ... except btcore.TreeError as error:
        ...     print([str(diagnostic.code) for diagnostic in error.diagnostics])
        ['E104']
    """

    def __init__(self, diagnostics: Iterable[Diagnostic]) -> None:
        self.diagnostics: tuple[Diagnostic, ...] = tuple(diagnostics)
        shown, more = shown_diagnostics(self.diagnostics)
        super().__init__("\n".join([*map(str, shown), *more]))


class XmlSyntaxError(TreeError):
    """A document is not XML, or not a document of behavior trees."""


class UnknownNodeError(TreeError):
    """The document uses a node that is not registered, because of a typo or a missing plugin."""


class PortError(TreeError):
    """A port is unknown, a value does not fit its type, or a script is invalid."""


class RegistrationError(BtcoreError):
    """A node, type or enum cannot be registered."""


MAX_SHOWN_ERRORS: Final = 9
"""The maximum number of later errors in the message of a NodeExecutionError."""


class NodeExecutionError(BtcoreError):
    """A node raised while it was ticked or halted; `__cause__` is the original exception.

    Attributes:
        path: The full path of the node.
        node_id: The registration ID of the node.
        cause: The original exception.
        doing: "ticking" or "being halted".
        where: `file:line` of the node in the XML; "" = unknown.
        backtrace: The paths of the nodes from the root to the node that raised.
        later_errors: The errors of other nodes, raised while the tree was halted afterwards.

    Examples:
        >>> import btcore
        >>> @btcore.action
        ... def grasp():
        ...     raise OSError("no gripper")
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(grasp)
        >>> b = btcore.Builder(nodes)
        >>> try:
        ...     b.build(b.Grasp()).tick_once()
        ... except btcore.NodeExecutionError as error:
        ...     print(error.path, "·", error.cause)
        Grasp::1 · no gripper
    """

    def __init__(
        self, path: str, node_id: str, cause: BaseException, doing: str = "ticking", where: str = ""
    ) -> None:
        self.path = path
        self.node_id = node_id
        self.cause = cause
        self.doing = doing
        self.where = where
        self.backtrace: list[str] = []
        self.later_errors: list[NodeExecutionError] = []
        super().__init__(path, node_id, str(cause))

    def __str__(self) -> str:
        class_name = type(self.cause).__name__
        message = str(self.cause)
        text = f"node '{self.path}' <{self.node_id}> raised while {self.doing}: {class_name}"
        if message:
            text += f": {message}"
        if self.where:
            text = f"{self.where}: {text}"
        for depth, step in enumerate(self.backtrace):
            mark = "→" if depth == len(self.backtrace) - 1 else " "
            text += f"\n    {mark} {'  ' * depth}{step}"
        for other in self.later_errors[:MAX_SHOWN_ERRORS]:
            text += f"\nand {other}"
        if len(self.later_errors) > MAX_SHOWN_ERRORS:
            text += f"\nand {len(self.later_errors) - MAX_SHOWN_ERRORS} more"
        return text


class NodeError(BtcoreError):
    """A node is used in an invalid way, for example with too few children or without a mandatory port."""


class BlackboardError(BtcoreError):
    """A blackboard entry is missing, was never written, or has another type.

    Attributes:
        unwritten_key: The key of an entry that is missing or was never written; "" for another problem.
    """

    unwritten_key: str = ""


class MissingEntryError(BlackboardError, KeyError):
    """A blackboard entry is missing, or was never written."""

    __str__ = Exception.__str__  # KeyError would quote the message


class EndOfTimeError(BtcoreError):
    """Raised by waiting on a clock whose time has ended, such as that of a recording. Ends `btcore run`."""


class ConversionError(BtcoreError, ValueError):
    """A text or a value cannot be converted to a type."""


class ScriptError(BtcoreError):
    """A script cannot be parsed or run.

    Attributes:
        message: The description of the error, without the script.
        text: The script.
        column: The place of the error in *text*, counted in characters from 1; 0 = unknown.
        width: The number of invalid characters.
        unwritten_key: The key of an entry that is missing or was never written; "" for another problem.

    Examples:
        >>> import btcore
        >>> try:
        ...     btcore.compile_script("a := (1 +")
        ... except btcore.ScriptError as error:
        ...     print(error.column)
        10
    """

    unwritten_key: str = ""

    def __init__(self, message: str, text: str = "", column: int = 0, width: int = 1) -> None:
        self.message = message
        self.text = text
        self.column = column
        self.width = width
        super().__init__(message)

    def __str__(self) -> str:
        if not self.text:
            return self.message
        if not self.column:
            return f"{self.message} in the script «{self.text}»"
        line = self.text.count("\n", 0, self.column - 1)
        start = self.text.rfind("\n", 0, self.column - 1) + 1
        shown = self.text[start:].split("\n", 1)[0]
        return f"{self.message}\n{excerpt(shown, line + 1, self.column - start, self.width)}"


class TickInterrupt(BaseException):  # not an Exception, so that no node catches it by mistake
    """Ends a tick, and is no error of a node: the engine passes it on as it passes on KeyboardInterrupt."""


class UndecidedOperandError(TickInterrupt):
    """A value that is not known was used, in a search of all runs (`btcore prove`).

    A node that compares the value calls `decide` for the result of the comparison.

    Attributes:
        operand: The value.
    """

    def __init__(self, message: str, operand: object) -> None:
        super().__init__(message)
        self.operand = operand

    def decide(self, operator: str, left: object, right: object) -> bool:
        """Return whether the search continues as if `left operator right` were true."""
        raise self


class SettingsError(BtcoreError, ValueError):
    """Options contradict each other, or the value of one cannot be used.

    Args:
        message: What is wrong; it names the options.
        setting: As the attribute.

    Attributes:
        setting: The field of the settings whose value cannot be used, such as "port"; "" = several, or none.
    """

    def __init__(self, message: str, setting: str = "") -> None:
        super().__init__(message)
        self.setting = setting


class ProviderError(BtcoreError):
    """Raised when providers cannot be used together, are declared wrongly, or raise an exception."""


class OutputError(BtcoreError):
    """Raised when an output of a run, such as a recording, is incomplete, for example on a full disk."""
