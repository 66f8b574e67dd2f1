"""W212: attributes that are no port, for want of a name that one may have."""

from btcore.names import fault_of_port
from btcore.xml.check import nodes_of
from btcore.xml.lint.advice import Advice, tag
from btcore.xml.plan import TreePlan


def check_ignored(plan: TreePlan, advice: Advice) -> None:
    """Warn of the attributes in *plan* that are read by nobody; those with an underscore are meant so."""
    document = plan.definition.document
    for node in nodes_of(plan):
        for key in node.attributes:
            if key[0] != "_" and key not in ("ID", "name"):
                why = fault_of_port(key)
                said = f"the attribute '{key}' of {tag(node)} is ignored: it can't be a port, as {why}"
                hint = "give the port another name, also where it is registered"
                advice.warn("W212", said, document, node, key, hint, part="name")
