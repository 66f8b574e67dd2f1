"""Which ROS 2 this Python uses, and what prevents its use. ROS 2 is not imported."""

import os
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Literal

from btcore.extras import install_command
from btcore_ros2.errors import RosError

INSTALL = f"{install_command('rclpy')} (Linux on x86-64), or source the setup file of your ROS 2"

# Libraries such as librmw_fastrtps_shared_cpp are parts of an implementation.
_MIDDLEWARE = re.compile(r"librmw_(?!\w*_shared_|\w*__)\w+_cpp|librmw_connextdds")

Kind = Literal["none", "wheels", "sourced", "mixed"]


@dataclass(frozen=True, slots=True)
class Installation:
    """The ROS 2 that this Python uses.

    Attributes:
        kind: "wheels" of the virtual environment, a "sourced" ROS 2, both ("mixed") or "none".
        distribution: The value of `ROS_DISTRO`, for example "jazzy"; "" if it is not set.
        folders: The folders with the module rclpy, in the order in which Python searches them.
        sourced: The folders of ROS 2 outside the virtual environment, for example /opt/ros/jazzy.
        middleware: The installed middleware implementations, for example "rmw_fastrtps_cpp".
        problem: What prevents the use of ROS 2; "" if nothing does.
        remedy: What to do about the problem.
    """

    kind: Kind
    distribution: str
    folders: Sequence[Path]
    sourced: Sequence[Path]
    middleware: Sequence[str]
    problem: str
    remedy: str


def find_installation(
    environment: Mapping[str, str] = os.environ, path: Sequence[str] | None = None
) -> Installation:
    """Return the ROS 2 that is found.

    Args:
        environment: The environment variables.
        path: The folders in which Python searches modules; None = `sys.path`.
    """
    searched = [Path(entry) for entry in (sys.path if path is None else path)]
    folders = [folder for folder in searched if (folder / "rclpy").is_dir()]
    wheels = [folder for folder in folders if next(folder.glob("ros_rclpy-*.dist-info"), None) is not None]
    own = {_prefix(folder).resolve() for folder in wheels}
    # A workspace with packages of the user has no librcl.so.
    prefixes = [
        *map(Path, filter(None, environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep))),
        *(Path(entry).parent for entry in environment.get("LD_LIBRARY_PATH", "").split(os.pathsep)),
    ]
    prefixes = [prefix for prefix in prefixes if (prefix / "lib" / "librcl.so").exists()]
    prefixes += [_prefix(folder) for folder in folders]
    sourced = [prefix for prefix in dict.fromkeys(prefixes) if prefix.resolve() not in own]
    kind: Kind = "none"
    if wheels:
        kind = "mixed" if sourced else "wheels"
    elif folders:
        kind = "sourced"
    libraries = {file.stem for prefix in (*own, *sourced) for file in (prefix / "lib").glob("librmw_*.so")}
    middleware = sorted(name.removeprefix("lib") for name in libraries if _MIDDLEWARE.fullmatch(name))
    problem, remedy = _problem(kind, folders, sourced, middleware, environment.get("RMW_IMPLEMENTATION", ""))
    return Installation(
        kind, environment.get("ROS_DISTRO", ""), folders, sourced, middleware, problem, remedy
    )


def check_installation() -> None:
    """Raise an exception if ROS 2 cannot be used here.

    Raises:
        RosError: The problem, see `Installation`.
    """
    found = find_installation()
    if found.problem:
        raise RosError(f"{found.problem}; {found.remedy}")


def _prefix(folder: Path) -> Path:
    """Return the prefix of a folder of modules, which is PREFIX/lib/python3.12/site-packages."""
    return folder.parents[2] if len(folder.parents) > 2 else folder


def _problem(
    kind: Kind, folders: Sequence[Path], sourced: Sequence[Path], middleware: Sequence[str], wanted: str
) -> tuple[str, str]:
    """Return what prevents the use of ROS 2, and the remedy; "" and "" if nothing does."""
    if kind == "none":
        where = f"; {sourced[0]} is sourced, but for another Python" if sourced else ""
        return f"ROS 2 is not installed for this Python{where}", INSTALL
    if kind == "mixed":
        return (
            f"two ROS 2 installations are mixed, the wheels in {sys.prefix} and {sourced[0]}: "
            "which of their libraries are loaded would be chance",
            "use a shell in which no setup file was sourced, or an environment without the extra ros2",
        )
    names = [file.name for file in (folders[0] / "rclpy").glob("_rclpy_pybind11*.so")]
    if names and not {f"_rclpy_pybind11{suffix}" for suffix in EXTENSION_SUFFIXES}.intersection(names):
        version = ".".join(map(str, sys.version_info[:2]))
        tags = ", ".join(name.split(".")[1] for name in names)
        return (
            f"the ROS 2 in {_prefix(folders[0])} is for another Python ({tags}), this is Python {version}",
            "use the Python of that ROS 2, or btcore[ros2] in a shell without its setup file",
        )
    if wanted and middleware and wanted not in middleware:
        return (
            f"the middleware RMW_IMPLEMENTATION={wanted} is not installed, only {', '.join(middleware)}",
            "unset RMW_IMPLEMENTATION, or install the middleware",
        )
    return "", ""
