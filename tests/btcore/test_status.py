"""`Status` behaves as any enum, on every Python, also where its metaclass is exchanged."""

import copy
import json
import pickle
import sys
from enum import Enum, EnumMeta, IntEnum
from typing import Any

import pytest

import btcore
from btcore import NodeType, Status

any_status: Any = Status


class Plain(IntEnum):
    IDLE = 0
    RUNNING = 1
    SUCCESS = 2
    FAILURE = 3
    SKIPPED = 4


def test_members_are_those_of_a_plain_enum() -> None:
    assert [(status.name, status.value) for status in Status] == [
        (status.name, status.value) for status in Plain
    ]
    assert [*reversed(Status)] == [*Status][::-1]
    assert len(Status) == len(Plain)
    assert Status.__members__ == {status.name: status for status in Status}
    assert Status(2) is Status["SUCCESS"] is Status.SUCCESS is btcore.SUCCESS
    assert Status.IDLE in Status
    assert bool(Status)
    assert repr(Status) == "<enum 'Status'>"
    assert set(dir(Plain)) <= set(dir(Status))


def test_members_are_copied_and_pickled_as_themselves() -> None:
    assert issubclass(Status, Enum)
    assert isinstance(Status, EnumMeta)
    assert pickle.loads(pickle.dumps(Status.FAILURE)) is Status.FAILURE
    assert copy.deepcopy(Status.FAILURE) is Status.FAILURE
    assert pickle.loads(pickle.dumps(Status)) is Status


def test_members_are_constants() -> None:
    with pytest.raises(AttributeError, match="SUCCESS"):
        any_status.SUCCESS = 3
    with pytest.raises(AttributeError, match="SUCCESS"):
        del any_status.SUCCESS
    with pytest.raises(AttributeError, match="DONE"):
        _ = any_status.DONE
    with pytest.raises(ValueError, match="9 is not a valid Status"):
        Status(9)
    with pytest.raises(TypeError, match="extend"):
        type("Wider", (any_status,), {})


def test_members_are_patterns() -> None:
    match Status.RUNNING:
        case Status.RUNNING | Status.IDLE:
            return
    raise AssertionError


@pytest.mark.skipif(sys.version_info >= (3, 12), reason="members are fast since Python 3.12")
def test_no_method_prevents_the_interpreter_from_caching_members() -> None:
    assert not hasattr(type(Status), "__getattr__")


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
