"""Check the attributes of nodes: missing ports, ignored attributes, texts that are probably misread.

The codes are W202, W203, W210, W211, W212 and W215, and for texts that are not checked at loading also E202.
"""

import re
from collections.abc import Iterator
from functools import lru_cache
from typing import Final

from btcore.blackboard.ports import (
    LOAD_TIME_ROLES,
    SCRIPT_ROLES,
    UNSET,
    Direction,
    Port,
    PortRole,
    remapped_key,
)
from btcore.diagnostic_codes import (
    EMPTY_PORT,
    IGNORED_ATTRIBUTE,
    INCOMPLETE_POINTER,
    INCONVERTIBLE_TEXT,
    PARTIAL_NUMBER,
    UNCHECKED_LITERAL,
    UNCONNECTED_OUTPUT,
)
from btcore.diagnostics import HintAndFixes
from btcore.engine.signature import PortAttribute
from btcore.errors import ConversionError
from btcore.fixes import SetAttributes, SetValue
from btcore.lint.check_context import CheckContext
from btcore.lint.possible_results import is_built_in
from btcore.names import SCRIPT_ATTRIBUTES, is_port_name, port_name_error
from btcore.registry.manifest import Manifest
from btcore.registry.nodes_without_code import is_mock
from btcore.suggestions import join_names, nearest_name
from btcore.values import NODE_STATUS, IntegerType, RealType, ValueType, VectorType
from btcore.values.numbers import whole_float
from btcore.xml.plan.tree_plan import NodePlan
from btcore.xml.plan.tree_planner import value_fixes
from btcore.xml.read.document import Mark

# Longer texts are not checked: the search for the longest number takes quadratic time.
_MAX_NUMBER_LENGTH: Final = 64
_INTEGER: Final = re.compile(r"-?[0-9]+")
_HALF_A_POINTER: Final = re.compile(r"\{(?P<open>[A-Za-z_@][\w.]*)|\$?\{?(?P<closed>[A-Za-z_@][\w.]*)\}")


def check_ignored_attributes(node: NodePlan, context: CheckContext) -> None:
    """Warn about ignored attributes.

    Editors keep their own data in attributes that begin with an underscore. Such a name is reported only if
    it resembles the name of a condition or a script.
    """
    for key in node.attributes:
        if key[0] == "_":
            near = _similar_attribute(key, node.subtree_call is not None)
            if near is not None:
                message = f"the attribute '{key}' of {node.label} is ignored: unknown name"
                advice = HintAndFixes.similar_name(near)
                context.report(node, IGNORED_ATTRIBUTE, message, *advice, attribute=key, part="name")
        elif key not in ("ID", "name"):
            reason = port_name_error(key)
            message = f"the attribute '{key}' of {node.label} is ignored: invalid port name ({reason})"
            hint = "rename the port, here and in the code that registers it"
            context.report(node, IGNORED_ATTRIBUTE, message, attribute=key, hint=hint, part="name")


@lru_cache(maxsize=64)  # every node of a file that btcore or Groot wrote may have the same attributes
def _similar_attribute(key: str, is_subtree: bool) -> str | None:
    """Return the name of the condition, script or option of a SubTree that *key* probably means."""
    names = [*SCRIPT_ATTRIBUTES, "_autoremap"] if is_subtree else SCRIPT_ATTRIBUTES
    return nearest_name(key, sorted(names))


def check_missing_ports(node: NodePlan, context: CheckContext) -> None:
    """Warn about missing ports without a default: *node* raises when it uses such a port."""
    manifest = node.manifest
    if node.subtree_call is not None or is_mock(manifest.cls):
        return
    set_names = {binding.name for binding in node.bindings}
    if any(is_port_name(key) and key not in manifest.ports for key in node.element.attributes):
        return  # reported as an unknown port, which is probably a misspelt required port
    missing = [
        port for port in manifest.ports.values() if port.name not in set_names and is_required(manifest, port)
    ]
    if not missing:
        return
    names = join_names([f"'{port.name}'" for port in missing])
    if len(missing) == 1:
        message = f"the port {names} of <{node.id}> is missing and has no default"
    else:
        message = f"the ports {names} of <{node.id}> are missing and have no default"
    examples = [f'{port.name}="…"' if port.reads else f'{port.name}="{{…}}"' for port in missing]
    values = {port.name: f"{{{port.name}}}" for port in missing}
    hint = "write " + " ".join(examples)
    context.report(node, EMPTY_PORT, message, hint=hint, fixes=[SetAttributes(values)])


def is_required(manifest: Manifest, port: Port) -> bool:
    """Return whether the node of *manifest* raises without *port*."""
    # A missing port with a load-time role is an error when the node is created (E205).
    if (
        port.default is not None
        or port.default_value is not UNSET
        or port.optional
        or port.role in LOAD_TIME_ROLES
    ):
        return False
    if is_built_in(manifest.cls):
        return port.reads
    # A leaf that lists its ports in provided_ports may check whether an output is connected.
    return port.reads or not is_listed(manifest, port)


def is_listed(manifest: Manifest, port: Port) -> bool:
    """Return whether a user's class lists *port* in provided_ports, so that only its code knows the use."""
    is_attribute = isinstance(getattr(manifest.cls, port.name, None), PortAttribute)
    return not (manifest.function is not None or is_attribute or is_built_in(manifest.cls))


def check_port_literals(node: NodePlan, context: CheckContext) -> None:
    """Warn about literals of *node* that are read only in part, or were probably meant as keys."""
    format = context.plans.format
    for binding in node.bindings:
        port, text = binding.port, binding.text
        is_literal = remapped_key(text, port.name, format) is None
        if not binding.is_explicit or not is_literal or port.role in SCRIPT_ROLES:
            continue
        label = f"port '{port.name}' of {node.label}"
        intended = intended_key(text)
        error = conversion_error(port, text, format)
        if error is not None:
            # The planner reports it in format 4, except for statuses; in format 3 it accepts every literal.
            reported = format == 4 and port.checks_text
            if not reported and port.reads and not is_mock(node.manifest.cls):
                message = f"the {label} has the type {port.type.name}: {error}"
                key = intended or (text if is_port_name(text) else "")
                hint, fixes = entry_hint("use the blackboard entry", key) if key else HintAndFixes()
                fixes = [*value_fixes(port.type), *fixes]
                context.report(node, INCONVERTIBLE_TEXT, message, hint, fixes, attribute=port.name)
        elif intended:
            message = f"the {label} is the text '{text}', not an entry"
            advice = entry_hint("use the entry", intended)
            context.report(node, INCOMPLETE_POINTER, message, *advice, attribute=port.name)
        elif port.direction is Direction.OUT and format == 4:
            message = f"the output {label} has no entry: '{text}' is only a text"
            key = f"{{{text}}}" if text.isidentifier() else f"{{{port.name}}}"
            shown = key if text.isidentifier() else "{…}"
            advice = HintAndFixes(f'write {port.name}="{shown}"', [SetValue(key)])
            context.report(node, UNCONNECTED_OUTPUT, message, *advice, attribute=port.name)
        else:
            for item, part, type_name in partly_read(text, _literal_type(node, port), format):
                message = f"the {label} has the type {type_name}: only '{part}' of '{item}' is read"
                advice = _number_hint(text, item, part, type_name)
                context.report(node, PARTIAL_NUMBER, message, *advice, attribute=port.name)
    for key, text in node.subtree_call.constants.items() if node.subtree_call is not None else ():
        intended = intended_key(text)
        if intended:
            message = f"'{key}' of {node.label} is the text '{text}', not an entry"
            advice = entry_hint("use the entry", intended)
            context.report(node, INCOMPLETE_POINTER, message, *advice, attribute=key)


def check_literals_of_class(node: NodePlan, context: CheckContext) -> None:
    """Report the problems that the class of *node* finds in literals; see `TreeNode.check_literals`."""
    if node.subtree_call is not None:
        return
    for problem in node.manifest.cls.check_literals(valid_literals(node)):
        code = UNCHECKED_LITERAL if problem.is_unchecked else INCONVERTIBLE_TEXT
        message = f"the port '{problem.port}' of {node.label}: {problem.message}"
        mark: Mark = {"attribute": problem.port, "column": problem.start, "width": problem.width}
        context.report(node, code, message, hint=problem.hint, **mark)


def valid_literals(node: NodePlan) -> dict[str, str]:
    """Return the texts of the input ports of *node* that are literals of the right type, by port."""
    return {
        binding.name: binding.text
        for binding in node.bindings
        if binding.key is None and not binding.error and binding.port.reads
    }


def conversion_error(port: Port, text: str, format: int) -> ConversionError | None:
    """Return why the literal *text* doesn't convert to the type of *port*, or None if it need not convert."""
    try:
        port.type.from_text(text, format)
    except ConversionError as error:
        return error if port.checks_text or port.type is NODE_STATUS else None
    return None


def intended_key(text: str) -> str:
    """Return the key that *text* probably names if its braces are incomplete or have a `$`, else ""."""
    match = _HALF_A_POINTER.fullmatch(text.strip(" "))
    return "" if match is None else match["open"] or match["closed"]


def _literal_type(node: NodePlan, port: Port) -> ValueType:
    """Return the type that a literal of *port* has; for a queue, a vector of the output port's type."""
    if port.role is not PortRole.QUEUE:
        return port.type
    elements = [other.type for other in node.manifest.ports.values() if not other.reads]
    return VectorType(elements[0]) if elements else port.type


def partly_read(text: str, value_type: ValueType, format: int) -> Iterator[tuple[str, str, str]]:
    """Yield the numbers in *text* that are read only in part, such as `1,5`, which is read as `1`.

    Yields:
        (number, part that is read, type name).
    """
    if isinstance(value_type, VectorType):
        if not (text.startswith("json:") and format == 4):
            for item in text.split(";"):
                yield from partly_read(item, value_type.item, format)
        return
    if not isinstance(value_type, (IntegerType, RealType)) or len(text) > _MAX_NUMBER_LENGTH:
        return
    try:
        value_type.from_text(text, format)
    except ConversionError:
        return  # an error, when the tree is loaded or when a node reads the port
    shown = text.strip()
    # Format 3 skips spaces and a plus sign, and accepts hexadecimal reals.
    bare = shown.removeprefix("+") if format == 3 else shown
    part = _read_part(bare, isinstance(value_type, IntegerType))
    if part is None or part == bare or re.fullmatch(r"\.0*", bare[len(part) :]):
        return
    if format == 3 and isinstance(value_type, RealType) and "x" in bare.lower():
        return
    yield shown, part, value_type.name


def _read_part(text: str, integer: bool) -> str | None:
    if integer:
        match = _INTEGER.match(text)
        return None if match is None else match.group()
    ends = range(len(text), 0, -1)
    return next((text[:end] for end in ends if whole_float(text[:end]) is not None), None)


def _number_hint(text: str, item: str, part: str, type_name: str) -> HintAndFixes:
    """Return the hint and the fix for *item*, a number in *text* of which only *part* is read."""
    with_point = item.replace(",", ".", 1)
    if type_name in ("double", "float") and whole_float(with_point) is not None:
        return HintAndFixes(f"write {with_point}", [SetValue(text.replace(item, with_point, 1))])
    fix = SetValue(text.replace(item, part, 1))
    return HintAndFixes(f"write {part} if that is the intended value", [fix])


def entry_hint(purpose: str, key: str) -> HintAndFixes:
    """Return the hint that a value with braces is needed, and the fix.

    Args:
        purpose: What the value with braces does, such as "use the entry".
    """
    return HintAndFixes(f"to {purpose}, write {{{key}}}", [SetValue(f"{{{key}}}")])
