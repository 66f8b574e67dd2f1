"""Statuses and node types as texts and as numbers."""

import json

import pytest

from btcore import NodeType, Status


@pytest.mark.parametrize("member", [*Status, *NodeType])
def test_member_is_printed_as_its_name(member: Status | NodeType, capsys: pytest.CaptureFixture[str]) -> None:
    print(member)
    assert capsys.readouterr().out == f"{member.name}\n"
    assert f"{member}" == str(member) == "%s" % member == member.name  # noqa: UP031
    assert f"{member:>12}" == member.name.rjust(12)


def test_status_is_still_a_number() -> None:
    assert Status.RUNNING == 1
    assert json.dumps([Status.RUNNING]) == "[1]"
    assert f"{int(Status.SUCCESS):03d}" == "002"
