"""Tests of ROS 2 receive on the loopback interface only."""

import os
from collections.abc import Iterator
from ipaddress import IPv4Address
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
if not Path("/proc/self/net/igmp").exists():
    pytest.skip("needs the tables of sockets in /proc", allow_module_level=True)

from std_msgs.msg import String

from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S

LOOPBACK = IPv4Address("127.0.0.1")


def own_sockets() -> set[str]:
    """Return the inodes of the sockets of this process."""
    found = set()
    for link in Path("/proc/self/fd").iterdir():
        try:
            target = str(link.readlink())
        except FileNotFoundError:  # the folder itself, while it is listed
            continue
        if target.startswith("socket:"):
            found.add(target.removeprefix("socket:[").rstrip("]"))
    return found


def bound_to(table: str) -> Iterator[tuple[IPv4Address, int]]:
    """Yield address and port of each socket of this process in *table*, such as "udp"."""
    own = own_sockets()
    for line in Path(f"/proc/self/net/{table}").read_text().splitlines()[1:]:
        fields = line.split()
        if fields[9] in own:
            address, _, port = fields[1].partition(":")
            yield IPv4Address(bytes.fromhex(address)[::-1]), int(port, 16)


def memberships() -> set[tuple[str, str]]:
    """Return the multicast groups of this machine: pairs of interface and group."""
    found = set()
    device = ""
    for line in Path("/proc/self/net/igmp").read_text().splitlines()[1:]:
        if line[0].isdigit():
            device = line.split()[1]
        else:
            found.add((device, line.split()[0]))
    return found


def test_no_socket_receives_from_another_interface(session: RosSession) -> None:
    """Fast DDS receives at fixed ports of its domain.

    It also opens sockets to send from all interfaces. They have other ports, are announced to no other
    process, and nothing is sent to another machine, because only 127.0.0.1 is searched for processes.
    """
    before = memberships()
    received: list[str] = []
    session.node.create_subscription(String, "words", lambda message: received.append(message.data), 10)
    with RosSession("other") as other:
        publisher = other.node.create_publisher(String, "words", 10)
        assert session.wait_for(publisher.get_subscription_count, LIMIT_S)
        publisher.publish(String(data="hello"))
        assert session.wait_for(lambda: received, LIMIT_S)
        first = 7400 + 250 * int(os.environ["ROS_DOMAIN_ID"])
        receiving = [(address, port) for address, port in bound_to("udp") if first <= port < first + 250]
        joined = {(device, group) for device, group in memberships() - before if device != "lo"}
    assert len(receiving) >= 4
    assert {address for address, _ in receiving} == {LOOPBACK}
    assert joined == set()
