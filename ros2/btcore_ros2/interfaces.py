"""Load the Python classes of messages, services and actions by their ROS names."""

import importlib
import re
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, Literal

from btcore.extras import install_command
from btcore.suggestions import did_you_mean, join_names, suggestion
from btcore_ros2.errors import RosError
from btcore_ros2.installation import Installation, find_installation
from btcore_ros2.message_packages.definitions import bundled_packages

InterfaceKind = Literal["msg", "srv", "action"]
"""The kind of an interface, as in its name: `geometry_msgs/msg/Twist`, `std_srvs/srv/Trigger`."""

_NOUNS: Final = {"msg": "message", "srv": "service", "action": "action"}
_NAME: Final = re.compile(r"([a-z][a-z0-9_]*)/(?:(msg|srv|action)/)?([A-Z][A-Za-z0-9]*)")
_TYPE_SUPPORT: Final = "*_s__rosidl_typesupport_c*"  # a file that each generated package contains


UNRELEASED: Final = {"btcpp_ros2_interfaces": "https://github.com/BehaviorTree/BehaviorTree.ROS2"}
"""The repositories of message packages that no release of ROS 2 contains."""


class InterfaceError(RosError):
    """Raised when a name does not name a message, service or action."""


class MissingPackageError(InterfaceError):
    """Raised when the package of a message, service or action is not installed.

    Attributes:
        package: The name of the package.
    """

    def __init__(self, package: str, message: str) -> None:
        super().__init__(message)
        self.package = package


def load_interface(name: str, kind: InterfaceKind) -> Any:
    """Return the class of a message, service or action.

    Args:
        name: The name, such as `nav2_msgs/action/NavigateToPose` or `nav2_msgs/NavigateToPose`.
        kind: The kind that the caller needs.

    Raises:
        MissingPackageError: The package is not installed.
        InterfaceError: The name is invalid, of another kind, or unknown in its package.
    """
    noun = _NOUNS[kind]
    match = _NAME.fullmatch(name)
    if match is None:
        raise InterfaceError(f"'{name}' is not the name of a ROS {noun}{_form_hint(name, kind)}")
    package, given, bare = match.groups()
    if given is not None and given != kind:
        raise InterfaceError(
            f"'{name}' is the name of {_article(_NOUNS[given])}, but {_article(noun)} is needed"
        )
    folder = _folder(package)
    if folder is None:
        raise MissingPackageError(package, f"the package '{package}' of '{name}' {_not_installed(package)}")
    if not (folder / kind / "__init__.py").is_file():
        raise InterfaceError(f"'{name}': the package {package} has no {noun}s{_elsewhere(folder, bare)}")
    try:
        module = importlib.import_module(f"{package}.{kind}")
    except ImportError as error:
        raise InterfaceError(
            f"'{name}' cannot be imported: {error}; is ROS 2 installed completely?"
        ) from error
    interface = getattr(module, bare, None)
    if not isinstance(interface, type):
        hint = _elsewhere(folder, bare) or did_you_mean(bare, interface_names(package, kind))
        raise InterfaceError(f"'{name}': the package {package} has no {noun} '{bare}'{hint}")
    return interface


def interface_name(interface: type) -> str:
    """Return the ROS name of a class: `geometry_msgs/msg/Twist`."""
    package, kind = interface.__module__.split(".")[:2]
    return f"{package}/{kind}/{interface.__name__}"


def interface_names(package: str, kind: InterfaceKind) -> list[str]:
    """Return the names of the messages, services or actions of *package*, without the package."""
    folder = _folder(package)
    if folder is None or not (folder / kind / "__init__.py").is_file():
        return []
    module = importlib.import_module(f"{package}.{kind}")
    # The module of an action also contains the parts of the action, such as NavigateToPose_Goal.
    return sorted(name for name, value in vars(module).items() if isinstance(value, type) and "_" not in name)


def message_packages() -> list[str]:
    """Return the names of the installed packages with messages, services or actions."""
    packages: set[str] = set()
    for entry in sys.path:
        packages |= {file.parent.name for file in Path(entry or ".").glob(f"*/{_TYPE_SUPPORT}")}
    return sorted(packages)


def package_remedy(package: str, installation: Installation) -> str:
    """Return the command that installs a package of messages."""
    if installation.kind != "sourced":
        source = package if package in bundled_packages() else f"PATH/{package}"
        return f"btcore ros2 messages {source}"
    if package in UNRELEASED:
        return (
            f"git clone {UNRELEASED[package]} in the folder src of your workspace, then "
            f"colcon build --packages-select {package}, and source the workspace again"
        )
    name = package.replace("_", "-")
    return f"sudo apt install ros-{installation.distribution or 'DISTRO'}-{name}"


def _folder(package: str) -> Path | None:
    """Return the folder of a package of generated messages, or None. The package is not imported.

    The name may be from an XML file of unknown origin. Importing any other package could have effects.
    """
    spec = find_spec(package)
    for location in (spec.submodule_search_locations or ()) if spec is not None else ():
        folder = Path(location)
        if next(folder.glob(_TYPE_SUPPORT), None) is not None:
            return folder
    return None


def _not_installed(package: str) -> str:
    installed = message_packages()
    if not installed:
        return (
            f"is not installed, nor is any other package with messages: {install_command('rclpy')}, "
            "or source the setup file of your ROS 2"
        )
    similar = "" if package in bundled_packages() else did_you_mean(package, installed)
    return f"is not installed{similar or ';'} run: {package_remedy(package, find_installation())}"


def _form_hint(name: str, kind: InterfaceKind) -> str:
    bare = re.split(r"[/.:]+", name)[-1]
    owners = [f"{package}/{kind}/{bare}" for package in _packages_with(bare, kind)]
    if owners:
        return f"; {suggestion(join_names(owners, 'or'))}"
    example = {
        "msg": "geometry_msgs/msg/Twist",
        "srv": "std_srvs/srv/Trigger",
        "action": "nav2_msgs/action/Spin",
    }
    return f": the form is package/{kind}/Name, for example {example[kind]}"


def _packages_with(bare: str, kind: InterfaceKind) -> Iterator[str]:
    if bare:
        yield from (package for package in message_packages() if bare in interface_names(package, kind))


def _elsewhere(folder: Path, bare: str) -> str:
    """Return a hint if *bare* is an interface of another kind in the same package."""
    for kind, noun in _NOUNS.items():
        if (folder / kind / "__init__.py").is_file():
            module = importlib.import_module(f"{folder.name}.{kind}")
            if isinstance(getattr(module, bare, None), type):
                return f", but {_article(noun)} '{folder.name}/{kind}/{bare}'"
    return ""


def _article(noun: str) -> str:
    return f"an {noun}" if noun == "action" else f"a {noun}"
