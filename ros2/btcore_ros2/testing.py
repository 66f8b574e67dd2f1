"""Tools for tests of programs that use ROS 2."""

import os
import sys
import tempfile
from pathlib import Path

from btcore_ros2.errors import RosError

DOMAINS = range(1, 102)
"""The domains that are safe on every platform, without the default domain 0."""

LOOPBACK_PROFILE = Path(__file__).with_name("loopback.xml")
"""A profile of Fast DDS that receives on the loopback interface only."""

_reserved: list[object] = []  # the open files, whose locks last until the process ends


def isolate_ros() -> int:
    """Let this process receive on the loopback interface only, in a domain that no other test uses.

    Call it before the first import of rclpy. Processes that this process starts inherit both, by environment
    variables. The domain is reserved until this process ends.

    Returns:
        The domain.

    Raises:
        RosError: All domains are reserved, or the platform is Windows.
    """
    if sys.platform == "win32":
        raise RosError("domains cannot be reserved on Windows")
    import fcntl

    for domain in DOMAINS:
        path = Path(tempfile.gettempdir(), f"btcore-ros-domain-{domain}.lock")
        file = path.open("a")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            file.close()
            continue
        _reserved.append(file)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        # LOCALHOST alone ignores other machines, but receives from all interfaces.
        os.environ["FASTDDS_DEFAULT_PROFILES_FILE"] = str(LOOPBACK_PROFILE)
        return domain
    raise RosError(f"all domains from {DOMAINS[0]} to {DOMAINS[-1]} are used by other tests on this machine")
