"""Find the blackboard keys that a node names: in ports and in scripts, with how it uses their entries."""

import enum
from collections.abc import Mapping
from typing import NamedTuple

from btcore.blackboard.ports import SCRIPT_ROLES, Port, PortRole, remapped_key
from btcore.errors import ScriptError
from btcore.lint.scripts import iter_subexpressions, parse_statements
from btcore.script.expressions import Assignment, Name


class AccessKind(enum.Enum):
    """How a script or a port uses an entry.

    - READS and WRITES: the value is read or written.
    - READS_AS_KEY: the value is read, and is the name of another entry, which is written.
    - ASSIGNS: the value is written, and the entry must exist already.
    - UPDATES: the value is read and written, for example by `+=`, and the entry must exist already.
    - MENTIONS: the entry is named, but its value is neither read nor written.
    """

    READS = enum.auto()
    WRITES = enum.auto()
    READS_AS_KEY = enum.auto()
    ASSIGNS = enum.auto()
    UPDATES = enum.auto()
    MENTIONS = enum.auto()


READING = (AccessKind.READS, AccessKind.READS_AS_KEY, AccessKind.UPDATES)
"""The kinds of access that read the entry."""
WRITING = (AccessKind.WRITES, AccessKind.ASSIGNS, AccessKind.UPDATES)
"""The kinds of access that write the entry."""
_ASSIGNMENTS = {":=": AccessKind.WRITES, "=": AccessKind.ASSIGNS}


class NameUse(NamedTuple):
    """One use of a name in a script; *column* counts from 1."""

    access: AccessKind
    name: str
    column: int


def find_name_uses(text: str, enums: Mapping[str, int]) -> list[NameUse]:
    """Return every use of an entry in a script, in the order of evaluation; none if the script is invalid.

    Args:
        enums: Values of the registered enum names, which are not entries.
    """
    try:
        statements = parse_statements(text, enums)
    except ScriptError:
        return []  # check_scripts has reported it
    uses: list[NameUse] = []
    for statement in statements:
        for part in iter_subexpressions(statement):
            if isinstance(part, Assignment) and isinstance(part.target, Name):
                target = part.target
                access = _ASSIGNMENTS.get(part.operator, AccessKind.UPDATES)
                uses.append(NameUse(access, target.name, target.column))
            elif isinstance(part, Name) and part.name not in enums:
                uses.append(NameUse(AccessKind.READS, part.name, part.column))
    return uses


def port_uses(
    port: Port, text: str, is_explicit: bool, format: int
) -> tuple[str | None, tuple[AccessKind, ...]]:
    """Return the key that the text of a port names, or None, and how a node uses the entry.

    The entries that a script uses are those of `find_name_uses`, unless the script itself is in an entry.

    Args:
        port: The port.
        text: The text of the port.
        is_explicit: Whether the document sets the port; otherwise the text is its default.
        format: The XML format, 3 or 4.
    """
    key = remapped_key(text, port.name, format)
    # A loop takes items out of its queue, but never fills it.
    writes = port.writes and port.role is not PortRole.QUEUE
    if key is None:
        if text and port.role in _ACCESS_BY_NAME:
            return text, (_ACCESS_BY_NAME[port.role],)
        # In format 3 an output port accepts the key without braces.
        is_bare_key = text and writes and format == 3 and is_explicit and port.role not in SCRIPT_ROLES
        return (text, (AccessKind.WRITES,)) if is_bare_key else (None, ())
    if port.role in SCRIPT_ROLES:
        return key, (AccessKind.READS,)
    if port.role is PortRole.WRITTEN_ENTRY:
        return key, (AccessKind.READS_AS_KEY,)
    reading = (AccessKind.READS,) if port.reads else ()
    # In format 3 the default of an output port is not connected.
    return key, (*reading, AccessKind.WRITES) if writes and (is_explicit or format == 4) else reading


_ACCESS_BY_NAME = {
    PortRole.WRITTEN_ENTRY: AccessKind.WRITES,
    PortRole.WATCHED_ENTRY: AccessKind.READS,
    PortRole.REMOVED_ENTRY: AccessKind.MENTIONS,
}
