"""Packages of message definitions are found, checked and ordered."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest

pytest.importorskip("rosidl_adapter")

from btcore_ros2.errors import RosError
from btcore_ros2.message_packages.definitions import (
    MessagePackage,
    bundled_packages,
    find_packages,
    leave_out_incomplete,
    select,
)

POINT = {("geometry_msgs", "Point")}


def write(folder: Path, files: Mapping[str, str]) -> str:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return str(folder)


def names(packages: Iterable[MessagePackage]) -> dict[str, list[str]]:
    return {package.name: [interface.name for interface in package.interfaces] for package in packages}


def test_bundled_definitions_need_only_messages_of_the_extra_ros2() -> None:
    packages = find_packages(bundled_packages())
    bundled = {"btcpp_ros2_interfaces", "geographic_msgs", "map_msgs", "nav2_msgs", "tf2_msgs"}
    assert set(names(packages)) == bundled
    needed = {name for package in packages for name in package.needs}
    installed = {"builtin_interfaces", "geometry_msgs", "nav_msgs", "sensor_msgs", "std_msgs"}
    assert needed <= {*installed, "geographic_msgs", "unique_identifier_msgs"}


def test_a_bundled_package_brings_the_bundled_packages_that_it_needs(tmp_path: Path) -> None:
    counts = {name: len(found) for name, found in names(find_packages(["nav2_msgs"])).items()}
    assert counts == {"nav2_msgs": 51, "geographic_msgs": 20}
    own = write(tmp_path, {"geographic_msgs/msg/GeoPose.msg": "float64 latitude\n"})
    assert names(find_packages(["nav2_msgs", own]))["geographic_msgs"] == ["GeoPose"]
    assert names(select(find_packages(["nav2_msgs"]), ["FollowGPSWaypoints"])) == {
        "nav2_msgs": ["WaypointStatus", "FollowGPSWaypoints"],
        "geographic_msgs": ["GeoPoint", "GeoPose"],
    }


def test_a_workspace_contains_packages_in_any_depth_except_in_the_folders_of_colcon(tmp_path: Path) -> None:
    workspace = write(
        tmp_path,
        {
            "src/robot/arm_msgs/msg/Arm.msg": "float64 angle\n",
            "src/robot/arm_msgs/package.xml": "<a><name>arm_interfaces</name><version>1.2.3</version></a>",
            "src/other/srv/Go.srv": "---\n",
            "src/ignored/COLCON_IGNORE": "",
            "src/ignored/msg/No.msg": "int8 x\n",
            "install/arm_msgs/msg/Arm.msg": "float64 angle\n",
        },
    )
    packages = find_packages([workspace])
    assert names(packages) == {"other": ["Go"], "arm_interfaces": ["Arm"]}
    assert {package.name: package.version for package in packages}["arm_interfaces"] == "1.2.3"


def test_packages_are_ordered_by_their_needs(tmp_path: Path) -> None:
    workspace = write(
        tmp_path,
        {"a/msg/A.msg": "b/B b\n", "b/msg/B.msg": "c/C[] c\n", "c/msg/C.msg": "geometry_msgs/Point point\n"},
    )
    ordered, incomplete = leave_out_incomplete(find_packages([workspace]), POINT)
    assert [package.name for package in ordered] == ["c", "b", "a"]
    assert not incomplete


def test_interfaces_with_missing_messages_are_left_out_with_those_containing_them(
    tmp_path: Path,
) -> None:
    workspace = write(
        tmp_path,
        {
            "a/msg/Place.msg": "geographic_msgs/GeoPose pose\n",
            "a/msg/Point.msg": "geometry_msgs/Point point\n",
            "a/action/Go.action": "Place place\n---\n---\nPoint now\n",
            "b/srv/Where.srv": "---\na/Place place\n",
        },
    )
    kept, incomplete = leave_out_incomplete(find_packages([workspace]), POINT)
    assert names(kept) == {"a": ["Point"]}
    assert incomplete == {
        ("a", "Place"): [("geographic_msgs", "GeoPose")],
        ("a", "Go"): [("a", "Place")],
        ("b", "Where"): [("a", "Place")],
    }


def test_only_keeps_what_the_named_interface_contains() -> None:
    packages = select(find_packages(["nav2_msgs", "tf2_msgs"]), ["NavigateThroughPoses"])
    assert names(packages) == {"nav2_msgs": ["WaypointStatus", "NavigateThroughPoses"]}
    with pytest.raises(RosError, match="no definition of that name; did you mean 'NavigateToPose'"):
        select(find_packages(["nav2_msgs"]), ["NavigateToPse"])


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"a/msg/A.msg": "float64\n"}, "a/msg/A.msg: not a valid definition"),
        ({"a/srv/A.srv": "float64 x\n"}, "a/srv/A.srv: not a valid definition"),
        ({"a/notes.txt": ""}, "no folder msg, srv or action"),
        ({"x/a/msg/A.msg": "int8 x\n", "y/a/msg/A.msg": "int8 x\n"}, "name only one of the folders"),
        ({"a b/msg/A.msg": "int8 x\n"}, "'a b' is not a valid name of a package"),
        ({"a/msg/A.msg": "int8 x\n", "a/package.xml": "<package>"}, r"a/package.xml: "),
    ],
)
def test_mistakes_are_reported_with_place(tmp_path: Path, files: Mapping[str, str], message: str) -> None:
    with pytest.raises(RosError, match=message):
        find_packages([write(tmp_path, files)])


def test_packages_that_need_each_other_are_an_error(tmp_path: Path) -> None:
    folder = write(tmp_path, {"a/msg/A.msg": "b/B b\n", "b/msg/B.msg": "a/A a\n"})
    with pytest.raises(RosError, match="need each other: "):
        leave_out_incomplete(find_packages([folder]), ())


def test_an_unknown_source_is_reported_with_the_nearest_bundled_package() -> None:
    with pytest.raises(RosError, match="did you mean 'nav2_msgs'"):
        find_packages(["nav_2msgs"])
