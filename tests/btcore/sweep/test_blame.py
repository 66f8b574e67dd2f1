"""Which node is said to have made a tree fail."""

import pytest

from btcore import Registry, SimClock, Status, loads
from btcore.sweep.blame import Blame


@pytest.mark.parametrize(
    ("body", "blamed"),
    [
        ('<Sequence><AlwaysSuccess/><AlwaysFailure name="last"/></Sequence>', "last"),
        ('<Fallback><AlwaysFailure name="a"/><AlwaysFailure name="b"/></Fallback>', "b"),
        ('<Inverter name="not"><AlwaysSuccess/></Inverter>', "not"),
        ('<Sequence><ForceFailure name="force"><AlwaysSuccess/></ForceFailure></Sequence>', "force"),
        ("<Sequence><Fallback><AlwaysFailure/><AlwaysSuccess/></Fallback></Sequence>", None),
        ('<Sequence><Sleep msec="250"/><AlwaysFailure name="late"/></Sequence>', "late"),
        ('<AlwaysFailure name="root"/>', "root"),
        (
            '<Sequence><Fallback><AlwaysFailure name="early"/><Sleep msec="150"/></Fallback>'
            '<AlwaysFailure name="late"/></Sequence>',
            "late",
        ),
    ],
)
def test_it_is_the_one_at_the_end_of_the_way_over_what_failed_in_the_last_tick(
    body: str, blamed: str | None
) -> None:
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    tree = loads(text, nodes=Registry.standard(), clock=SimClock())
    blame = Blame()
    with blame.attach(tree, [], {}):
        status = tree.tick_while_running(period=0.1)
        tree.halt()
    assert blame.first == blamed
    assert (status is Status.FAILURE) == (blamed is not None)
