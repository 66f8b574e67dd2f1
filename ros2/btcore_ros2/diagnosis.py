"""What works and what does not in the ROS 2 of this machine and in its network, for `btcore ros2 doctor`."""

import os
import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Literal

from btcore_ros2.installation import Installation, find_installation
from btcore_ros2.interfaces import package_remedy

BUNDLED_PACKAGES = {
    "tf2_msgs": "transforms",
    "nav2_msgs": "Nav2's actions and services",
    "map_msgs": "the updates of costmaps",
    "btcpp_ros2_interfaces": "the tree server",
}
"""The message packages that parts of btcore need and PyPI lacks, and what they are for."""

LAST_SAFE_DOMAIN = 101

Level = Literal["ok", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Finding:
    """A result of the diagnosis.

    Attributes:
        level: "ok", "warning" or "error"; an error prevents the use of ROS 2.
        subject: What was examined, for example "domain".
        text: What was found.
        remedy: What to do about it; "" if nothing is to be done.
    """

    level: Level
    subject: str
    text: str
    remedy: str = ""


def examine_machine() -> Iterator[Finding]:
    """Yield the findings about the installation and the environment variables. ROS 2 is not imported."""
    environment = os.environ
    installation = find_installation(environment)
    yield _check_installation(installation)
    yield Finding("ok", "Python", platform.python_version())
    yield _domain(environment.get("ROS_DOMAIN_ID") or "0")
    yield _discovery(environment)
    if installation.middleware:
        used = environment.get("RMW_IMPLEMENTATION") or f"{installation.middleware[0]} (default)"
        yield Finding("ok", "middleware", f"{used}; installed: {', '.join(installation.middleware)}")
    for package, purpose in () if installation.problem else BUNDLED_PACKAGES.items():
        if find_spec(package) is None:
            yield Finding(
                "warning",
                "messages",
                f"{package} is not installed; needed for {purpose}",
                package_remedy(package, installation),
            )


def _check_installation(installation: Installation) -> Finding:
    if installation.problem:
        return Finding("error", "installation", installation.problem, installation.remedy)
    name = f" {installation.distribution}" if installation.distribution else ""
    if installation.kind == "wheels":
        return Finding("ok", "installation", f"wheels in {installation.folders[0]}")
    return Finding("ok", "installation", f"sourced ROS 2{name} in {installation.sourced[0]}")


def _domain(domain: str) -> Finding:
    if not domain.isdecimal() or int(domain) > 232:
        return Finding("error", "domain", f"ROS_DOMAIN_ID={domain}", "use a number from 0 to 101")
    if int(domain) > LAST_SAFE_DOMAIN:
        remedy = "domains above 101 may share ports with other programs: use 0 to 101"
        return Finding("warning", "domain", f"ROS_DOMAIN_ID={domain}", remedy)
    return Finding("ok", "domain", f"{domain}; the robot must use the same")


def _discovery(environment: Mapping[str, str]) -> Finding:
    allowed = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
    range_setting = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"
    peers = environment.get("ROS_STATIC_PEERS", "")
    text = range_setting + (f", peers {peers}" if peers else "")
    if range_setting not in allowed:
        remedy = f"ROS_AUTOMATIC_DISCOVERY_RANGE must be one of {', '.join(allowed)}"
        return Finding("warning", "discovery", text, remedy)
    if environment.get("ROS_LOCALHOST_ONLY") == "1":
        remedy = "ROS_LOCALHOST_ONLY is deprecated: set ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST instead"
        return Finding("warning", "discovery", "this machine only", remedy)
    if range_setting in ("LOCALHOST", "OFF"):
        reach = "this machine only" if range_setting == "LOCALHOST" else "no automatic discovery"
        return Finding("ok", "discovery", f"{text}: {reach}")
    return Finding("ok", "discovery", text)
