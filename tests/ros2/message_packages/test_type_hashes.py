"""The bundled definitions have the type hashes of the original packages."""

import json
import sys
from pathlib import Path

import pytest

pytest.importorskip("rosidl_adapter")
pytest.importorskip("rclpy")

from btcore_ros2.message_packages.definitions import find_packages, leave_out_incomplete
from btcore_ros2.message_packages.wheels import Build, installed_messages

HASHES = Path(__file__).with_name("type_hashes.txt")
"""What ROS 2's generator computed from the definitions of the releases for kilted: nav2_msgs 1.4.2,
geographic_msgs 1.0.6 and map_msgs 2.5.0. A type hash covers the names, types and order of all fields."""


def test_type_hashes_are_those_of_the_original_packages(tmp_path: Path) -> None:
    expected = dict(line.split() for line in HASHES.read_text(encoding="utf-8").splitlines())
    packages = find_packages(["nav2_msgs", "map_msgs"])
    complete, incomplete = leave_out_incomplete(packages, installed_messages(Path(sys.prefix)))
    assert {package.name for package in complete} == {"geographic_msgs", "map_msgs", "nav2_msgs"}
    assert not incomplete
    computed = {}
    for package in complete:
        build = Build(package, tmp_path, lambda: None)
        build.describe()
        for interface in package.interfaces:
            file = build.share / interface.kind / f"{interface.name}.json"
            first = json.loads(file.read_text(encoding="utf-8"))["type_hashes"][0]
            computed[first["type_name"]] = first["hash_string"]
    assert computed == expected
