"""W212: attributes that are ignored because their name is not a valid port name."""

from btcore.diagnostic_codes import IGNORED_ATTRIBUTE
from btcore.names import port_name_error
from btcore.xml.lint.advice import LintReporter, node_label
from btcore.xml.plan.document_checks import nodes_of
from btcore.xml.plan.plan import TreePlan


def check_ignored(plan: TreePlan, reporter: LintReporter) -> None:
    """Warn about attributes in *plan* that are ignored, except for names that begin with an underscore."""
    document = plan.definition.document
    for node in nodes_of(plan):
        for key in node.attributes:
            if key[0] != "_" and key not in ("ID", "name"):
                reason = port_name_error(key)
                message = (
                    f"the attribute '{key}' of {node_label(node)} is ignored: invalid port name ({reason})"
                )
                hint = "rename the port, here and in the code that registers it"
                reporter.warn(IGNORED_ATTRIBUTE, message, document, node, key, hint, part="name")
