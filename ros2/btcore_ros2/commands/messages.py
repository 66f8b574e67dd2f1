"""`btcore ros2 messages`: build and install message packages that are not on PyPI."""

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from btcore.suggestions import counted, join_names
from btcore_ros2.errors import RosError
from btcore_ros2.message_packages.definitions import (
    MessagePackage,
    bundled_packages,
    find_packages,
    leave_out_incomplete,
    select,
)

_SHOWN_MISSING: Final = 8
"""How many interfaces that are left out are listed."""


@click.command(short_help="Build and install message packages.")
@click.argument("sources", nargs=-1, metavar="[FOLDER|NAME]...")
@click.option(
    "--only",
    multiple=True,
    metavar="INTERFACE",
    help="Build the package with only this message, service or action, and the messages in it.",
)
@click.option("--force", is_flag=True, help="Build packages that are up to date again.")
@click.option(
    "--wheels",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Install the wheels in FOLDER that fit. Other packages are built, and FOLDER keeps their wheels.",
)
def messages(sources: Sequence[str], only: Sequence[str], force: bool, wheels: Path | None) -> None:
    """Build message packages from their definitions, and install them into this environment.

    FOLDER is a package with folders msg, srv or action, or a workspace that contains packages. NAME is a
    package whose definitions come with btcore: tf2_msgs, map_msgs, btcpp_ros2_interfaces, geographic_msgs,
    or nav2_msgs, with which geographic_msgs is built. Without arguments, these five packages are built.

    Each package becomes a wheel, which pip installs and `pip uninstall` removes. A package is built again
    only if its definitions or ROS 2's generators have changed. Building needs a C and a C++ compiler.

    A wheel in the folder of --wheels fits if it was built from the same definitions with the same
    generators, by the same version of btcore and of Python.

    \b
      btcore ros2 messages nav2_msgs
      btcore ros2 messages --wheels dist/messages
      btcore ros2 messages ~/robot_ws/src
      btcore ros2 messages control_msgs --only JointJog
    """
    _check_environment()
    _install(select(find_packages(sources or bundled_packages()), only), force, wheels)


def _check_environment() -> None:
    """Raise an exception if the packages cannot be installed here."""
    from btcore_ros2.message_packages.wheels import missing_generators

    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    sourced = [
        prefix for prefix in prefixes if prefix and Path(prefix).resolve() != Path(sys.prefix).resolve()
    ]
    if sourced:
        raise click.UsageError(
            f"ROS 2 is sourced ({sourced[0]}): build the packages with colcon, "
            "or run this command in a shell in which no setup file was sourced"
        )
    _require(missing_generators())


def _require(missing: Sequence[str]) -> None:
    if missing:
        lines = "".join(f"\n  {line}" for line in missing)
        raise click.ClickException(f"message packages cannot be built here:{lines}")


def _install(packages: Sequence[MessagePackage], force: bool, folder: Path | None) -> None:
    """Install *packages* in their order, and print what happens to each; see the options of the command."""
    from btcore_ros2.message_packages import wheels

    own = []
    for package in packages:
        installed = wheels.installed_version(package.name)
        if installed is None or wheels.MARK in installed:
            own.append(package)
        else:
            click.echo(f"{package.name}: {installed} is installed from elsewhere, and stays as it is")
    names = {package.name for package in own}
    installed_messages = wheels.installed_messages(Path(sys.prefix))
    others = [message for message in installed_messages if message[0] not in names]
    complete, incomplete = leave_out_incomplete(own, others)
    for (name, interface), missing in list(incomplete.items())[:_SHOWN_MISSING]:
        needed = join_names(f"{other}/{message}" for other, message in missing)
        click.echo(f"{name}: {interface} is left out, because {needed} is not installed", err=True)
    if len(incomplete) > _SHOWN_MISSING:
        click.echo(f"{len(incomplete) - _SHOWN_MISSING} more interfaces are left out", err=True)
    if own and not complete:
        raise RosError("nothing is left to build; name the folders of the missing packages too")
    versions: dict[str, str] = {}
    for package in complete:
        versions[package.name] = wheels.wheel_version(package, versions)
        if wheels.installed_version(package.name) == versions[package.name] and not force:
            click.echo(f"{package.name}: up to date")
            continue
        start = time.monotonic()
        wheel = folder / wheels.wheel_name(package, versions[package.name]) if folder else None
        origin = ""
        if wheel is not None and wheel.is_file() and not force:
            wheels.install_wheel(wheel)
            origin = f" from {folder}"
        else:
            if wheel is not None and not force:
                click.echo(f"{package.name}: no wheel in {folder} fits, so one is built", err=True)
            _build(package, versions[package.name], folder)
        count = len(package.interfaces)
        interfaces = counted(count, "interface")
        click.echo(f"{package.name}: {interfaces} installed{origin} in {time.monotonic() - start:.0f} s")


def _build(package: MessagePackage, version: str, kept: Path | None) -> None:
    from btcore_ros2.message_packages import wheels

    _require(wheels.missing_compilers())
    console = Console(stderr=True)
    with Progress(
        TextColumn("[bold]{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        task = progress.add_task(package.name, total=wheels.count_jobs(package))
        wheels.build_and_install(package, version, lambda: progress.advance(task), kept)
