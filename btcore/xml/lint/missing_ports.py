"""W202: required ports that are missing."""

from btcore.blackboard.ports import LOAD_TIME_ROLES, UNSET, Port
from btcore.diagnostic_codes import EMPTY_PORT
from btcore.engine.signature import PortAttribute
from btcore.names import is_port_name
from btcore.registry.manifest import Manifest
from btcore.suggestions import join_names
from btcore.xml.lint.advice import LintReporter, is_built_in, is_stub
from btcore.xml.plan.document_checks import nodes_of
from btcore.xml.plan.plan import TreePlan


def check_missing_ports(plan: TreePlan, reporter: LintReporter) -> None:
    """Warn about the nodes of *plan* that raise as soon as they use a missing port."""
    document = plan.definition.document
    for node in nodes_of(plan):
        manifest = node.manifest
        if manifest is None or node.call is not None or is_stub(manifest):
            continue
        given = {port.name for port, _, _ in node.ports}
        if any(is_port_name(key) and key not in manifest.ports for key in node.element.attributes):
            continue  # reported as an unknown port, which is probably a misspelt required port
        missing = [
            port for port in manifest.ports.values() if port.name not in given and is_required(manifest, port)
        ]
        if not missing:
            continue
        names = join_names([f"'{port.name}'" for port in missing])
        if len(missing) == 1:
            message = f"the port {names} of <{node.id}> is missing and has no default"
        else:
            message = f"the ports {names} of <{node.id}> are missing and have no default"
        examples = [f'{port.name}="…"' if port.reads else f'{port.name}="{{…}}"' for port in missing]
        hint = "write " + " ".join(examples)
        reporter.warn(EMPTY_PORT, message, document, node, hint=hint)


def is_required(manifest: Manifest, port: Port) -> bool:
    """Return whether the node of *manifest* raises without *port*."""
    # A missing port with a load-time role is an error of the builder (E205).
    if port.default is not None or port.value is not UNSET or port.optional or port.role in LOAD_TIME_ROLES:
        return False
    if is_built_in(manifest):
        return port.reads
    # A leaf that lists its ports in provided_ports may check whether an output is connected.
    attribute = getattr(manifest.cls, port.name, None)
    listed = manifest.function is None and not isinstance(attribute, PortAttribute)
    return port.reads or not listed
