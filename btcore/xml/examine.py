"""Define and plan the trees of documents."""

from btcore.diagnostic_codes import UNKNOWN_FORMAT
from btcore.registry.registry import Registry
from btcore.xml.define import define
from btcore.xml.plan.plan import Plans, plan
from btcore.xml.read.read import Sources


def examine(
    sources: Sources,
    nodes: Registry,
    tree: str | None = None,
    format: int | None = None,
    every_tree: bool = False,
) -> Plans:
    """Return the plans of the trees of documents.

    If the main document states no format, and format 4 would avoid errors, the first error says so.

    Args:
        sources: The documents.
        nodes: The registered nodes.
        tree: ID of the main tree; by default the main document determines it.
        format: 3 or 4, overriding the main document's `BTCPP_format`.
        every_tree: As in `plan`.
    """
    plans = plan(define(sources, tree, format), nodes, every_tree)
    root = sources.main.root
    errors = plans.diagnostics.errors
    if errors and format is None and root.get("BTCPP_format") is None:
        # These plans need no hints.
        silent = sources._replace(diagnostics=sources.diagnostics._replace(comparisons=0))
        as_format_4 = plan(define(silent, tree, 4), nodes, every_tree)
        avoided = len(errors) - len(as_format_4.diagnostics.errors)
        if avoided > 0:
            count = "1 error" if avoided == 1 else f"{avoided} errors"
            message = f"missing BTCPP_format: the document is read as format 3; format 4 avoids {count}"
            hint = 'write <root BTCPP_format="4">'
            cause = sources.main.diagnostic(UNKNOWN_FORMAT, message, root, hint=hint)
            return plans._replace(diagnostics=plans.diagnostics._replace(errors=(cause, *errors)))
    return plans
