"""Classes of messages are found by their ROS names, and errors suggest what exists."""

import sys
from pathlib import Path

import pytest

from btcore_ros2.installation import Installation, Kind
from btcore_ros2.interfaces import (
    InterfaceError,
    InterfaceKind,
    MissingPackageError,
    interface_name,
    interface_names,
    load_interface,
    message_packages,
    package_remedy,
)


def test_package_that_is_not_installed_is_named_with_what_to_do() -> None:
    with pytest.raises(
        MissingPackageError, match=r"'rover_msgs' of 'rover_msgs/msg/Wheel' is not installed"
    ) as caught:
        load_interface("rover_msgs/msg/Wheel", "msg")
    assert caught.value.package == "rover_msgs"
    expected = "btcore ros2 messages PATH/rover_msgs" if message_packages() else "pip install 'btcore[ros2]'"
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("kind", "package", "remedy"),
    [
        ("wheels", "btcpp_ros2_interfaces", "btcore ros2 messages btcpp_ros2_interfaces"),
        ("wheels", "rover_msgs", "btcore ros2 messages PATH/rover_msgs"),
        ("sourced", "rover_msgs", "sudo apt install ros-jazzy-rover-msgs"),
        (
            "sourced",
            "btcpp_ros2_interfaces",
            "git clone https://github.com/BehaviorTree/BehaviorTree.ROS2 in",
        ),
    ],
)
def test_remedy_for_missing_package_depends_on_installation(kind: Kind, package: str, remedy: str) -> None:
    assert package_remedy(package, Installation(kind, "jazzy", (), (), (), "", "")).startswith(remedy)


def test_package_without_messages_is_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "dangerous" / "msg").mkdir(parents=True)
    (tmp_path / "dangerous" / "__init__.py").write_text("raise SystemExit('imported')")
    (tmp_path / "dangerous" / "msg" / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(MissingPackageError, match="'dangerous'"):
        load_interface("dangerous/msg/Message", "msg")
    assert "dangerous" not in sys.modules


@pytest.mark.parametrize(
    "name", ["", "os", "nav2_msgs/action/", "../msg/X", "a/msg/b/C", "nav2_msgs/action/Spin "]
)
def test_invalid_name_is_an_error(name: str) -> None:
    with pytest.raises(InterfaceError, match="is not the name of a ROS action"):
        load_interface(name, "action")


class TestWithMessages:
    """Tests that need installed messages."""

    @pytest.fixture(autouse=True)
    def _needs_ros(self) -> None:
        pytest.importorskip("test_msgs")

    def test_long_and_short_names_are_the_same_class(self) -> None:
        from geometry_msgs.msg import Twist

        assert load_interface("geometry_msgs/msg/Twist", "msg") is Twist
        assert load_interface("geometry_msgs/Twist", "msg") is Twist
        assert interface_name(Twist) == "geometry_msgs/msg/Twist"
        assert interface_name(load_interface("test_msgs/Fibonacci", "action")) == "test_msgs/action/Fibonacci"

    @pytest.mark.parametrize(
        ("name", "kind", "problem"),
        [
            ("geometry_msgs/msg/Twst", "msg", "no message 'Twst'; did you mean 'Twist'?"),
            ("geometry_msgs/action/Twist", "msg", "is the name of an action, but a message is needed"),
            ("geometry_msgs/Twist", "action", "has no actions, but a message 'geometry_msgs/msg/Twist'"),
            ("Twist", "msg", "did you mean geometry_msgs/msg/Twist?"),
            ("geometry_msgs.msg.Twist", "msg", "did you mean geometry_msgs/msg/Twist?"),
            ("geometry_mgs/msg/Twist", "msg", "is not installed; did you mean 'geometry_msgs'?"),
            ("Nothing", "srv", "the form is package/srv/Name, for example std_srvs/srv/Trigger"),
        ],
    )
    def test_unknown_name_is_an_error_with_a_suggestion(
        self, name: str, kind: InterfaceKind, problem: str
    ) -> None:
        with pytest.raises(InterfaceError) as caught:
            load_interface(name, kind)
        assert problem in str(caught.value)

    def test_parts_of_actions_are_not_listed(self) -> None:
        assert "Fibonacci" in interface_names("test_msgs", "action")
        assert not [name for name in interface_names("test_msgs", "action") if "_" in name]
        assert {"geometry_msgs", "std_srvs", "test_msgs"} <= set(message_packages())
        assert "numpy" not in message_packages()
