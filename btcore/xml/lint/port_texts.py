"""W203, W210, W211: texts of ports that are not what they look like; E202 of format 3."""

import re
from collections.abc import Iterator
from typing import Final

from btcore.blackboard.ports import SCRIPT_ROLES, Direction, Port, PortRole, remapped_key
from btcore.diagnostic_codes import INCOMPLETE_POINTER, INCONVERTIBLE_TEXT, PARTIAL_NUMBER, UNCONNECTED_OUTPUT
from btcore.errors import ConversionError
from btcore.names import is_port_name
from btcore.values import (
    IntegerType,
    RealType,
    ValueType,
    VectorType,
)
from btcore.values.numbers import whole_float
from btcore.xml.lint.advice import LintReporter, is_stub, node_label
from btcore.xml.plan.document_checks import nodes_of
from btcore.xml.plan.plan import NodePlan, TreePlan

_LONGEST: Final = 64
_INTEGER: Final = re.compile(r"-?[0-9]+")
_HALF_A_POINTER: Final = re.compile(r"\{(?P<open>[A-Za-z_@][\w.]*)|\$?\{?(?P<closed>[A-Za-z_@][\w.]*)\}")


def check_port_literals(plan: TreePlan, format: int, reporter: LintReporter) -> None:
    """Warn of the literals in *plan* that are read in part, or were meant as keys."""
    document = plan.definition.document
    for node in nodes_of(plan):
        for port, text, is_written in node.ports:
            if not is_written or remapped_key(text, port.name, format) is not None:
                continue
            if port.role in SCRIPT_ROLES:
                continue
            error = _refusal(port.type, text, format)
            if error is not None:
                # The loader of format 4 says it itself; that of format 3 takes every literal.
                if format == 3 and port.reads and node.manifest and not is_stub(node.manifest):
                    _unreadable(plan, node, port, text, error, reporter)
                continue
            meant = intended_key(text)
            if meant:
                message = (
                    f"the port '{port.name}' of {node_label(node)} is given the text '{text}', not an entry"
                )
                reporter.warn(
                    INCOMPLETE_POINTER, message, document, node, port.name, f"for the entry write {{{meant}}}"
                )
            elif port.direction is Direction.OUT and format == 4:
                _no_entry(plan, node, port, text, reporter)
            else:
                for item, part, kind in partly_read(text, _kind(node, port), format):
                    takes = f"the port '{port.name}' of {node_label(node)} takes {kind}"
                    message = f"{takes}: of '{item}' only '{part}' is read"
                    hint = f"write {_instead(item, part, kind)}"
                    reporter.warn(PARTIAL_NUMBER, message, document, node, port.name, hint)
        if node.call is not None:
            for key, text in node.call.constants.items():
                meant = intended_key(text)
                if meant:
                    message = f"'{key}' of {node_label(node)} is given the text '{text}', not an entry"
                    reporter.warn(
                        INCOMPLETE_POINTER, message, document, node, key, f"for the entry write {{{meant}}}"
                    )


def _no_entry(plan: TreePlan, node: NodePlan, port: Port, text: str, reporter: LintReporter) -> None:
    message = f"the port '{port.name}' of {node_label(node)} is to be written, but '{text}' names no entry"
    hint = f'write {port.name}="{{{text if text.isidentifier() else "…"}}}"'
    reporter.warn(UNCONNECTED_OUTPUT, message, plan.definition.document, node, port.name, hint)


def _unreadable(
    plan: TreePlan, node: NodePlan, port: Port, text: str, error: ConversionError, reporter: LintReporter
) -> None:
    """Say that *node* will raise when it reads its port."""
    message = f"the port '{port.name}' of {node_label(node)} takes {port.type.name}: {error}"
    meant = intended_key(text) or (text if is_port_name(text) else "")
    hint = f"for the blackboard's entry write {{{meant}}}" if meant else ""
    reporter.warn(INCONVERTIBLE_TEXT, message, plan.definition.document, node, port.name, hint)


def _refusal(kind: ValueType, text: str, format: int) -> ConversionError | None:
    """Why the literal *text* can't be read as a *kind*; None if it can, or anything goes."""
    try:
        kind.from_text(text, format)
    except ConversionError as error:
        return error if kind.strong and kind.converts else None
    return None


def intended_key(text: str) -> str:
    """The key that *text* was meant to name, if a brace is missing or one too many is written; else ""."""
    found = _HALF_A_POINTER.fullmatch(text.strip(" "))
    if found is None:
        return ""
    return found["open"] or found["closed"] or ""


def _kind(node: NodePlan, port: Port) -> ValueType:
    """The type of *port*; of a queue that of its elements."""
    if port.role is not PortRole.QUEUE or node.manifest is None:
        return port.type
    elements = [other.type for other in node.manifest.ports.values() if not other.reads]
    return VectorType(elements[0]) if elements else port.type


def partly_read(text: str, kind: ValueType, format: int) -> Iterator[tuple[str, str, str]]:
    """The numbers of *text* that are read only in part: each whole, the part, and what it is read as."""
    if isinstance(kind, VectorType):
        if not (text.startswith("json:") and format == 4):
            for item in text.split(";"):
                yield from partly_read(item, kind.item, format)
        return
    if not isinstance(kind, (IntegerType, RealType)) or len(text) > _LONGEST:
        return
    try:
        kind.from_text(text, format)
    except ConversionError:
        return  # refused, at load or when it is read
    shown = text.strip()
    # Format 3 skips spaces and a plus sign, and knows hexadecimal reals.
    bare = shown.removeprefix("+") if format == 3 else shown
    part = _read_part(bare, isinstance(kind, IntegerType))
    if part is None or part == bare or re.fullmatch(r"\.0*", bare[len(part) :]):
        return
    if format == 3 and isinstance(kind, RealType) and "x" in bare.lower():
        return
    yield shown, part, kind.name


def _read_part(text: str, integer: bool) -> str | None:
    """The beginning of *text* that is a number."""
    if integer:
        found = _INTEGER.match(text)
        return None if found is None else found.group()
    ends = range(len(text), 0, -1)
    return next((text[:end] for end in ends if whole_float(text[:end]) is not None), None)


def _instead(item: str, part: str, kind: str) -> str:
    comma = item.replace(",", ".", 1)
    if kind in ("double", "float") and whole_float(comma) is not None:
        return comma
    return f"{part}, if that is meant"
