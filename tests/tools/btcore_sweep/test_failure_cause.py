"""The node that made a tree fail."""

import pytest

from btcore import Registry, SimClock, Status, loads
from btcore_sweep.episode import FailureCauseFinder


@pytest.mark.parametrize(
    ("body", "cause"),
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
def test_the_cause_is_found_by_following_failed_nodes_down(body: str, cause: str | None) -> None:
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    tree = loads(text, nodes=Registry.standard(), clock=SimClock())
    finder = FailureCauseFinder()
    tree.subscribe(finder)
    status = tree.tick_while_running(period=0.1)
    tree.halt()
    assert finder.find(tree) == cause
    assert (status is Status.FAILURE) == (cause is not None)
