"""W104: trees that the main one never gets to."""

from collections.abc import Collection

from btcore.xml.faults import Faults
from btcore.xml.forest import Definition
from btcore.xml.plan import Planner


def check_unused(planner: Planner, main: Definition, used: Collection[str], faults: Faults) -> None:
    """Warn of the trees of the main document that neither *main* nor another unused one calls."""
    forest = planner.forest
    document = forest.documents[-1]
    unused = [one for one in forest.by_id.values() if one.id not in used and one.document is document]
    called = {
        call.call.tree
        for one in unused
        for call in planner.plan(one).calls
        if call.call is not None and call.call.tree != one.id
    }
    for one in unused:
        if one.id not in called and one.element.get("ID") is not None:
            said = f"the tree '{one.id}' is never used: '{main.id}' doesn't lead to it"
            hint = f'call it by <SubTree ID="{one.id}"/>, or remove it'
            faults.add(one.document.diagnostic("W104", said, one.element, "ID", hint=hint))
