"""W203, W210, W211: port texts that are read differently than intended; E202 in format 3."""

import re
from collections.abc import Iterator
from typing import Final

from btcore.blackboard.ports import SCRIPT_ROLES, Direction, Port, PortRole, remapped_key
from btcore.diagnostic_codes import INCOMPLETE_POINTER, INCONVERTIBLE_TEXT, PARTIAL_NUMBER, UNCONNECTED_OUTPUT
from btcore.errors import ConversionError
from btcore.names import is_port_name
from btcore.values import IntegerType, RealType, ValueType, VectorType
from btcore.values.numbers import whole_float
from btcore.xml.lint.advice import LintReporter, is_stub, node_label
from btcore.xml.plan.document_checks import nodes_of
from btcore.xml.plan.plan import NodePlan, TreePlan

# Longer texts are no numbers; the search for the longest number takes quadratic time.
_LONGEST: Final = 64
_INTEGER: Final = re.compile(r"-?[0-9]+")
_HALF_A_POINTER: Final = re.compile(r"\{(?P<open>[A-Za-z_@][\w.]*)|\$?\{?(?P<closed>[A-Za-z_@][\w.]*)\}")


def check_port_literals(plan: TreePlan, format: int, reporter: LintReporter) -> None:
    """Warn about literals in *plan* that are read only in part, or were probably meant as keys.

    Args:
        plan: The tree to check.
        format: The format of the tree, 3 or 4.
        reporter: Collects the warnings.
    """
    document = plan.definition.document
    for node in nodes_of(plan):
        for port, text, is_written in node.ports:
            if not is_written or remapped_key(text, port.name, format) is not None:
                continue
            if port.role in SCRIPT_ROLES:
                continue
            error = _refusal(port.type, text, format)
            if error is not None:
                # The planner reports it in format 4; in format 3 it accepts every literal.
                if format == 3 and port.reads and node.manifest and not is_stub(node.manifest):
                    _unreadable(plan, node, port, text, error, reporter)
                continue
            intended = intended_key(text)
            if intended:
                message = f"the port '{port.name}' of {node_label(node)} is the text '{text}', not an entry"
                hint = f"to use the entry, write {{{intended}}}"
                reporter.warn(INCOMPLETE_POINTER, message, document, node, port.name, hint)
            elif port.direction is Direction.OUT and format == 4:
                _no_entry(plan, node, port, text, reporter)
            else:
                for item, part, kind in partly_read(text, _kind(node, port), format):
                    message = (
                        f"the port '{port.name}' of {node_label(node)} has the type {kind}: "
                        f"only '{part}' of '{item}' is read"
                    )
                    hint = f"write {_replacement(item, part, kind)}"
                    reporter.warn(PARTIAL_NUMBER, message, document, node, port.name, hint)
        if node.call is not None:
            for key, text in node.call.constants.items():
                intended = intended_key(text)
                if intended:
                    message = f"'{key}' of {node_label(node)} is the text '{text}', not an entry"
                    hint = f"to use the entry, write {{{intended}}}"
                    reporter.warn(INCOMPLETE_POINTER, message, document, node, key, hint)


def _no_entry(plan: TreePlan, node: NodePlan, port: Port, text: str, reporter: LintReporter) -> None:
    message = f"the output port '{port.name}' of {node_label(node)} has no entry: '{text}' is only a text"
    hint = f'write {port.name}="{{{text if text.isidentifier() else "…"}}}"'
    reporter.warn(UNCONNECTED_OUTPUT, message, plan.definition.document, node, port.name, hint)


def _unreadable(
    plan: TreePlan, node: NodePlan, port: Port, text: str, error: ConversionError, reporter: LintReporter
) -> None:
    """Report that *node* raises when it reads *port*."""
    message = f"the port '{port.name}' of {node_label(node)} has the type {port.type.name}: {error}"
    intended = intended_key(text) or (text if is_port_name(text) else "")
    hint = f"to use the blackboard entry, write {{{intended}}}" if intended else ""
    reporter.warn(INCONVERTIBLE_TEXT, message, plan.definition.document, node, port.name, hint)


def _refusal(kind: ValueType, text: str, format: int) -> ConversionError | None:
    """Return why the literal *text* doesn't convert to *kind*, or None if it does or *kind* is not strict."""
    try:
        kind.from_text(text, format)
    except ConversionError as error:
        return error if kind.strong and kind.converts else None
    return None


def intended_key(text: str) -> str:
    """Return the key that *text* probably names if its braces are incomplete or have a ``$``, else ""."""
    match = _HALF_A_POINTER.fullmatch(text.strip(" "))
    if match is None:
        return ""
    return match["open"] or match["closed"] or ""


def _kind(node: NodePlan, port: Port) -> ValueType:
    """Return the type that a literal of *port* has; for a queue, a vector of the output port's type."""
    if port.role is not PortRole.QUEUE or node.manifest is None:
        return port.type
    elements = [other.type for other in node.manifest.ports.values() if not other.reads]
    return VectorType(elements[0]) if elements else port.type


def partly_read(text: str, kind: ValueType, format: int) -> Iterator[tuple[str, str, str]]:
    """Yield the numbers of *text* that are read only in part, as (number, part that is read, type name).

    Args:
        text: The literal.
        kind: The type of the port.
        format: The format of the tree, 3 or 4.
    """
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
        return  # an error, when the tree is loaded or when a node reads the port
    shown = text.strip()
    # Format 3 skips spaces and a plus sign, and accepts hexadecimal reals.
    bare = shown.removeprefix("+") if format == 3 else shown
    part = _read_part(bare, isinstance(kind, IntegerType))
    if part is None or part == bare or re.fullmatch(r"\.0*", bare[len(part) :]):
        return
    if format == 3 and isinstance(kind, RealType) and "x" in bare.lower():
        return
    yield shown, part, kind.name


def _read_part(text: str, integer: bool) -> str | None:
    """Return the longest beginning of *text* that is a number, or None."""
    if integer:
        match = _INTEGER.match(text)
        return None if match is None else match.group()
    ends = range(len(text), 0, -1)
    return next((text[:end] for end in ends if whole_float(text[:end]) is not None), None)


def _replacement(item: str, part: str, kind: str) -> str:
    with_point = item.replace(",", ".", 1)
    if kind in ("double", "float") and whole_float(with_point) is not None:
        return with_point
    return f"{part} if that is the intended value"
