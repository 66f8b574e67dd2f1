"""Leaves with string annotations, as `from __future__ import annotations` creates them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from btcore import In, Out, Put, RegistrationError, Registry, Status, SyncAction, action
from tests.btcore.conftest import TreeFactory

if TYPE_CHECKING:
    from fractions import Fraction


class Pose:
    def __init__(self, x: float) -> None:
        self.x = x


class Halve(SyncAction):
    given: In[float]
    made: Out[float]

    def __init__(self, pose: Pose) -> None:
        self.pose = pose

    def tick(self) -> Status:
        self.made = self.given / 2 + self.pose.x
        return Status.SUCCESS


def test_string_annotations_are_resolved_in_the_module_of_the_leaf(make_tree: TreeFactory) -> None:
    @action
    def double(given: In[float], made: Put[float], pose: Pose) -> bool:
        made(given * 2 + pose.x)
        return True

    body = '<Sequence><Halve given="3" made="{h}"/><Double given="3" made="{d}"/></Sequence>'
    tree = make_tree(body, Halve, double, resources=[Pose(0.25)])
    tree.tick_once()
    assert (tree.blackboard["h"], tree.blackboard["d"]) == (1.75, 6.25)


def test_string_annotations_may_name_local_classes() -> None:
    class Local:
        pass

    @action
    def look(at: In[Local]) -> bool:
        return True

    class Look2(SyncAction):
        at: In[Local]

    nodes = Registry.standard()
    nodes.add(look, Look2)
    nodes.replace(Look2=Look2)
    assert nodes.manifests["Look"].ports["at"].type.python_type is Local
    assert nodes.manifests["Look2"].ports["at"].type.python_type is Local


def test_unresolvable_annotation_is_reported() -> None:
    @action
    def share(part: In[Fraction]) -> bool:
        return True

    with pytest.raises(RegistrationError, match=r"share is annotated with 'Fraction', .*TYPE_CHECKING"):
        Registry.standard().add(share)
