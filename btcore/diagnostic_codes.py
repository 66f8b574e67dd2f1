"""The table of diagnostic codes, with the kind, the summary and the documentation of each code.

docs/reference/errors.md describes the codes; a test compares the page with this table.
"""

import re
from typing import Final, Literal

from btcore.documentation_site import FIRST_PAGE

Severity = Literal["error", "warning", "change"]
"""An error or a warning about a document, or a change in its conversion to format 4."""
DiagnosticKind = Literal[
    "document error", "tree error", "unknown node", "port error",
    "warning",
    "same meaning", "new meaning", "manual step",
]  # fmt: skip
"""The kind of an error, from which the exception follows, or "warning", or the effect of a change."""

_SEVERITIES: Final[dict[DiagnosticKind, Severity]] = {
    "warning": "warning",
    "same meaning": "change",
    "new meaning": "change",
    "manual step": "change",
}


class DiagnosticCode(str):
    """A diagnostic code of the table below: a str such as "E101", with a kind and a summary.

    Attributes:
        kind: The kind of the error, or "warning", or the effect of the change.
        summary: A short description, such as "unknown node".

    Examples:
        >>> from btcore.diagnostic_codes import UNKNOWN_PORT
        >>> UNKNOWN_PORT, UNKNOWN_PORT.kind, UNKNOWN_PORT.severity, UNKNOWN_PORT.summary
        ('E201', 'port error', 'error', 'unknown port')
    """

    # A subclass of str, and not an Enum: a hundred members of an Enum would slow down `import btcore`.
    __slots__ = ("kind", "summary")
    kind: DiagnosticKind
    summary: str

    def __new__(cls, text: str, kind: DiagnosticKind, summary: str) -> "DiagnosticCode":
        """Create an entry of the table; other modules use the constants below."""
        code = super().__new__(cls, text)
        code.kind = kind
        code.summary = summary
        return code

    def __getnewargs__(self) -> tuple[str, DiagnosticKind, str]:  # type: ignore[override]
        """Return the arguments of `__new__`, for copies and pickles."""
        return str(self), self.kind, self.summary

    @property
    def severity(self) -> Severity:
        """Whether the code is that of an error, a warning or a change."""
        return _SEVERITIES.get(self.kind, "error")

    @property
    def url(self) -> str:
        """The address of the heading in the documentation that describes the code."""
        heading = f"{self} · {self.summary}".lower()
        anchor = re.sub(r"[^\w -]", "", heading).replace(" ", "-")
        return f"{FIRST_PAGE}reference/errors.html#{anchor}"


# The document itself
EMPTY_DOCUMENT: Final = DiagnosticCode("E001", "document error", "empty document")
NOT_XML: Final = DiagnosticCode("E002", "document error", "not well-formed XML")
UNREADABLE_FILE: Final = DiagnosticCode("E003", "tree error", "unreadable file")
NOT_UTF8: Final = DiagnosticCode("E004", "document error", "not UTF-8")
DOCUMENT_TYPE: Final = DiagnosticCode("E005", "document error", "document type declaration")
TOO_DEEP: Final = DiagnosticCode("E006", "document error", "nesting too deep")
INCLUDE_FAILED: Final = DiagnosticCode("E007", "document error", "include failed")
NOT_A_ROOT: Final = DiagnosticCode("E008", "document error", "root element is not `root`")
UNKNOWN_FORMAT: Final = DiagnosticCode("E009", "document error", "unknown format")
DOCUMENT_TOO_LARGE: Final = DiagnosticCode("E010", "document error", "document too large")

# Nodes and trees
UNKNOWN_NODE: Final = DiagnosticCode("E101", "unknown node", "unknown node")
MISSING_ID: Final = DiagnosticCode("E102", "tree error", "missing ID or name")
UNEXPECTED_ID: Final = DiagnosticCode("E103", "tree error", "unexpected ID")
WRONG_CHILD_COUNT: Final = DiagnosticCode("E104", "tree error", "wrong number of children")
TREE_NAMED_AS_NODE: Final = DiagnosticCode("E105", "tree error", "tree has the name of a node")
TREE_WITHOUT_ID: Final = DiagnosticCode("E106", "tree error", "tree without an ID")
INVALID_NAME: Final = DiagnosticCode("E107", "tree error", "invalid name")
UNDETERMINED_MAIN_TREE: Final = DiagnosticCode("E108", "tree error", "main tree not determined")
UNKNOWN_TREE: Final = DiagnosticCode("E109", "tree error", "unknown subtree")
RECURSIVE_TREES: Final = DiagnosticCode("E110", "tree error", "recursive trees")
DUPLICATE_SUBTREE_PATH: Final = DiagnosticCode("E112", "tree error", "duplicate subtree path")
DUPLICATE_MODELS: Final = DiagnosticCode("E113", "tree error", "several models sections")
SEVERAL_ASYNC_SEQUENCES: Final = DiagnosticCode(
    "E114", "tree error", "several AsyncSequences in a ReactiveSequence"
)
LEAF_INIT_RAISED: Final = DiagnosticCode("E115", "tree error", "leaf constructor raised an exception")
CONTROL_CHARACTER_IN_NAME: Final = DiagnosticCode("E116", "tree error", "control character in a name")
TREE_TOO_LARGE: Final = DiagnosticCode("E117", "tree error", "tree too large")
NODE_NOT_CREATED: Final = DiagnosticCode("E118", "tree error", "node not created")
FIRST_TICK_REFUSED: Final = DiagnosticCode("E119", "tree error", "children rejected by the first tick")
NOT_FOR_A_BATCH: Final = DiagnosticCode("E120", "tree error", "not supported in a batch")  # of btcore_batch

# Ports, keys and scripts
UNKNOWN_PORT: Final = DiagnosticCode("E201", "port error", "unknown port")
INCONVERTIBLE_TEXT: Final = DiagnosticCode("E202", "port error", "text not convertible")
CONFLICTING_ENTRY_TYPES: Final = DiagnosticCode("E203", "port error", "conflicting types of an entry")
MISSING_SUBTREE_PORT: Final = DiagnosticCode("E204", "port error", "missing port of a subtree")
MISSING_PORT: Final = DiagnosticCode("E205", "port error", "missing mandatory port")
SCRIPT_SYNTAX: Final = DiagnosticCode("E206", "port error", "script syntax error")
NOT_A_BOOLEAN: Final = DiagnosticCode("E207", "port error", "not a boolean")

# Warnings about documents, nodes and trees
BARE_MARKUP: Final = DiagnosticCode("W101", "warning", "bare `<` or `&` in an attribute")
DUPLICATE_TREE_ID: Final = DiagnosticCode("W102", "warning", "duplicate tree ID")
CAPITALISED_ROOT: Final = DiagnosticCode("W103", "warning", "`Root` element")
UNUSED_TREE: Final = DiagnosticCode("W104", "warning", "unused tree")
UNREACHABLE_CHILD: Final = DiagnosticCode("W105", "warning", "unreachable child")
SECOND_ASYNC_CHILD: Final = DiagnosticCode(
    "W106", "warning", "several asynchronous children in a reactive node"
)
IGNORED_PACKAGE: Final = DiagnosticCode("W107", "warning", "ignored package")
LOOSE_TEXT: Final = DiagnosticCode("W108", "warning", "text between elements")
LENIENT_XML: Final = DiagnosticCode("W109", "warning", "not well-formed, but accepted")
ENDLESS_TICK: Final = DiagnosticCode("W110", "warning", "endless tick")

# Warnings about ports, keys and scripts
UNWRITTEN_KEY: Final = DiagnosticCode("W201", "warning", "key read but never written")
EMPTY_PORT: Final = DiagnosticCode("W202", "warning", "port without a value")
PARTIAL_NUMBER: Final = DiagnosticCode("W203", "warning", "number read in part")
USELESS_REMAPPING: Final = DiagnosticCode("W204", "warning", "unused remapping")
BRACES_IN_FORMAT_3: Final = DiagnosticCode("W205", "warning", "braces in a `SubTree` of format 3")
REFUSED_ENTRY_VALUE: Final = DiagnosticCode("W206", "warning", "value does not fit the entry's type")
SCRIPT_RAISES: Final = DiagnosticCode("W207", "warning", "script always raises")
CONDITION_ASSIGNS: Final = DiagnosticCode("W208", "warning", "assignment in a condition")
ASSIGNMENT_TO_MISSING_ENTRY: Final = DiagnosticCode("W209", "warning", "assignment to a missing entry")
INCOMPLETE_POINTER: Final = DiagnosticCode("W210", "warning", "incomplete braces")
UNCONNECTED_OUTPUT: Final = DiagnosticCode("W211", "warning", "output port without an entry")
IGNORED_ATTRIBUTE: Final = DiagnosticCode("W212", "warning", "ignored attribute")
TEXT_FOR_UNTYPED_ENTRY: Final = DiagnosticCode("W213", "warning", "text for an entry without a type")
BASE_CLASS_READ: Final = DiagnosticCode("W214", "warning", "entry of a base class")
UNCHECKED_LITERAL: Final = DiagnosticCode("W215", "warning", "literal not checked")

# The codes of tools, such as those of the conversion in btcore_studio, are in this table because a code must
# have the same meaning in all packages, and docs/reference/errors.md describes all codes.

# Conversion: written differently, with the same meaning
FORMAT_SET: Final = DiagnosticCode("C101", "same meaning", "format attribute set")
NODE_RENAMED: Final = DiagnosticCode("C102", "same meaning", "node renamed")
ATTRIBUTE_RENAMED: Final = DiagnosticCode("C103", "same meaning", "attribute renamed")
BRACES_ADDED: Final = DiagnosticCode("C104", "same meaning", "braces added")
TEXT_REWRITTEN: Final = DiagnosticCode("C105", "same meaning", "text rewritten")
TAG_MADE_COMPACT: Final = DiagnosticCode("C106", "same meaning", "tag made compact")
IGNORED_ATTRIBUTE_REMOVED: Final = DiagnosticCode("C107", "same meaning", "ignored attribute removed")

# Conversion: another meaning in format 4
ONE_CYCLE_PER_TICK: Final = DiagnosticCode("C201", "new meaning", "one cycle per tick")
SEQUENCE_MEMORY: Final = DiagnosticCode("C202", "new meaning", "sequence memory")
PARALLEL_THRESHOLDS: Final = DiagnosticCode("C203", "new meaning", "parallel thresholds")
SWITCH_COMPARISON: Final = DiagnosticCode("C204", "new meaning", "switch comparison")
ENTRY_TYPE_KEPT: Final = DiagnosticCode("C205", "new meaning", "entry type kept")
SUBTREE_NAME: Final = DiagnosticCode("C206", "new meaning", "subtree name")
REMAPPING_CHANGED: Final = DiagnosticCode("C207", "new meaning", "remapping changed")
SHARED_BLACKBOARD: Final = DiagnosticCode("C208", "new meaning", "shared blackboard")
AUTOREMAP_ALL: Final = DiagnosticCode("C209", "new meaning", "autoremap of all names")
NUMERIC_CONSTANT: Final = DiagnosticCode("C210", "new meaning", "numeric constant")
CHECKED_ONCE: Final = DiagnosticCode("C211", "new meaning", "condition checked once")
TEXT_REINTERPRETED: Final = DiagnosticCode("C212", "new meaning", "text reinterpreted")
LAST_TREE_USED: Final = DiagnosticCode("C213", "new meaning", "last tree used")
EMPTY_ATTRIBUTE_REMOVED: Final = DiagnosticCode("C214", "new meaning", "empty attribute removed")

# Conversion: left to the user
MANUAL_STEP: Final = DiagnosticCode("C301", "manual step", "manual step")

ALL_CODES: Final = tuple(value for value in list(globals().values()) if isinstance(value, DiagnosticCode))
"""Every code, in the order of the table."""
