"""W212: attributes that are no port, for want of a name that one may have."""

from btcore.diagnostic_codes import IGNORED_ATTRIBUTE
from btcore.names import port_name_error
from btcore.xml.lint.advice import LintReporter, node_label
from btcore.xml.plan.document_checks import nodes_of
from btcore.xml.plan.plan import TreePlan


def check_ignored(plan: TreePlan, reporter: LintReporter) -> None:
    """Warn of the attributes in *plan* that are read by nobody; those with an underscore are meant so."""
    document = plan.definition.document
    for node in nodes_of(plan):
        for key in node.attributes:
            if key[0] != "_" and key not in ("ID", "name"):
                why = port_name_error(key)
                message = (
                    f"the attribute '{key}' of {node_label(node)} is ignored: it can't be a port, as {why}"
                )
                hint = "give the port another name, also where it is registered"
                reporter.warn(IGNORED_ATTRIBUTE, message, document, node, key, hint, part="name")
