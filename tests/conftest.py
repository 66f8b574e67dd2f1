"""Fixtures for the tests of several packages: the tree of the BehaviorTree.CPP recordings."""

from collections.abc import Callable

import pytest


@pytest.fixture
def recorded_tree() -> Callable[[str], str]:
    """Return a function that writes the document of that tree, with *inside* as its subtree's sequence."""

    def write(inside: str) -> str:
        return f"""
            <root BTCPP_format="4" main_tree_to_execute="Main">
              <BehaviorTree ID="Main">
                <Sequence name="root_seq">
                  <Script code="x:=42; s:='hello'; f:=2.5"/>
                  <Fallback>
                    <AlwaysFailure/>
                    <Count name="cnt" _onSuccess="done:=true" out="{{val}}" ticks="3"/>
                  </Fallback>
                  <SubTree ID="Sub" lim="7" mode="fast" target="{{val}}"/>
                  <AlwaysSuccess _skipIf="x==42"/>
                </Sequence>
              </BehaviorTree>
              <BehaviorTree ID="Sub">
                <Sequence>{inside}</Sequence>
              </BehaviorTree>
            </root>
        """

    return write
