"""Definitions of messages, services and actions in folders, and what they need from other packages."""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import TYPE_CHECKING, Final

from btcore.suggestions import did_you_mean, join_names
from btcore_ros2.errors import RosError

if TYPE_CHECKING:
    from rosidl_adapter.parser import MessageSpecification

KINDS: Final = ("msg", "srv", "action")
"""The folders of a package, and the extensions of the files in them."""

BUNDLED: Final = Path(__file__).parent / "bundled"
"""The folder of the definitions that come with btcore, of ROS 2 kilted."""

_SKIPPED_FOLDERS: Final = {"build", "install", "log"}
"""The folders that colcon writes in a workspace."""


@dataclass(frozen=True)
class Interface:
    """A message, service or action.

    Attributes:
        kind: A member of `KINDS`.
        name: The name, for example `NavigateToPose`.
        text: The definition, without carriage returns.
        needs: The messages that occur in it, as `(package, name)`.
    """

    kind: str
    name: str
    text: str
    needs: frozenset[tuple[str, str]]


@dataclass(frozen=True)
class MessagePackage:
    """The definitions of a package.

    Attributes:
        name: The name of the package.
        version: The version in its package.xml; "0" without one.
        folder: Where it was found.
        interfaces: The definitions, sorted by kind and name.
    """

    name: str
    version: str
    folder: Path
    interfaces: tuple[Interface, ...]

    @property
    def needs(self) -> set[str]:
        """The names of the other packages whose messages it contains."""
        return {package for interface in self.interfaces for package, _ in interface.needs} - {self.name}


def bundled_packages() -> list[str]:
    """Return the names of the packages whose definitions come with btcore."""
    return sorted(path.name for path in BUNDLED.iterdir())


def find_packages(sources: Iterable[str]) -> list[MessagePackage]:
    """Return the packages in the folders *sources*, which can also be names of `bundled_packages`.

    The bundled packages that a bundled package needs are added.

    Raises:
        RosError: A source is unknown or contains no package, two packages have the same name, or a definition
            is not valid.
    """
    found: dict[str, MessagePackage] = {}
    for source in sources:
        for folder in _folders(source):
            package = _read(folder)
            if found.setdefault(package.name, package).folder != folder:
                raise RosError(
                    f"the package {package.name} is in {found[package.name].folder} and in {folder}; "
                    "name only one of the folders"
                )
    bundled = [package for package in found.values() if package.folder.parent == BUNDLED]
    needed = {name for package in bundled for name in package.needs} & set(bundled_packages())
    for name in sorted(needed - found.keys()):
        found[name] = _read(BUNDLED / name)
    return list(found.values())


def _folders(source: str) -> list[Path]:
    """Return the folders of the packages in *source*."""
    path = Path(source)
    if not path.is_dir():
        bundled = bundled_packages()
        if source in bundled:
            return [BUNDLED / source]
        raise RosError(
            f"{source}: neither a folder, nor a package whose definitions come with btcore "
            f"({join_names(bundled, 'or')}){did_you_mean(source, bundled)}"
        )
    folders = list(_below(path))
    if not folders:
        raise RosError(f"{source}: no folder msg, srv or action with definitions in it")
    return folders


def _below(path: Path) -> Iterator[Path]:
    if (path / "COLCON_IGNORE").exists():
        return
    if any(next((path / kind).glob(f"*.{kind}"), None) for kind in KINDS):
        yield path
    else:
        for child in sorted(path.iterdir()):
            if child.is_dir() and child.name not in _SKIPPED_FOLDERS and not child.name.startswith("."):
                yield from _below(child)


def _read(folder: Path) -> MessagePackage:
    name, version = folder.resolve().name, "0"
    manifest = folder / "package.xml"
    if manifest.exists():
        from lxml import etree

        try:
            root = etree.parse(manifest).getroot()
        except (etree.XMLSyntaxError, OSError) as error:
            raise RosError(f"{manifest}: {error}") from None
        name = (root.findtext("name") or name).strip()
        version = (root.findtext("version") or version).strip()
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise RosError(
            f"{folder}: '{name}' is not a valid name of a package; package.xml can contain another"
        )
    files = [file for kind in KINDS for file in sorted((folder / kind).glob(f"*.{kind}"))]
    return MessagePackage(name, version, folder, tuple(_read_interface(name, file) for file in files))


def _read_interface(package: str, file: Path) -> Interface:
    kind, name = file.suffix.removeprefix("."), file.stem
    try:
        text = file.read_text(encoding="utf-8")
        needs = {
            (field.type.pkg_name, field.type.type)
            for message in _messages(package, kind, name, text)
            for field in message.fields
            if not field.type.is_primitive_type()
        }
    except Exception as error:  # the parser raises exceptions of many types
        raise RosError(f"{file}: not a valid definition: {error or type(error).__name__}") from error
    return Interface(kind, name, text, frozenset(needs))


def _messages(package: str, kind: str, name: str, text: str) -> "Sequence[MessageSpecification]":
    """Return the messages that a definition consists of."""
    from rosidl_adapter import parser

    if kind == "msg":
        return [parser.parse_message_string(package, name, text)]
    if kind == "srv":
        service = parser.parse_service_string(package, name, text)
        return [service.request, service.response]
    action = parser.parse_action_string(package, name, text)
    return [action.goal, action.result, action.feedback]


def select(packages: Sequence[MessagePackage], only: Collection[str]) -> list[MessagePackage]:
    """Return the packages reduced to the interfaces named *only* and the messages that these contain.

    Raises:
        RosError: None of the packages has an interface of that name.
    """
    if not only:
        return list(packages)
    names = {interface.name for package in packages for interface in package.interfaces}
    for name in only:
        if name not in names:
            raise RosError(f"--only {name}: no definition of that name{did_you_mean(name, names)}")
    kept = {
        (package.name, interface.kind, interface.name)
        for package in packages
        for interface in package.interfaces
        if interface.name in only
    }
    before = -1
    while len(kept) != before:
        before = len(kept)
        kept |= {
            (needed, "msg", message)
            for package in packages
            for interface in package.interfaces
            if (package.name, interface.kind, interface.name) in kept
            for needed, message in interface.needs
        }
    reduced = (
        replace(
            package,
            interfaces=tuple(
                interface
                for interface in package.interfaces
                if (package.name, interface.kind, interface.name) in kept
            ),
        )
        for package in packages
    )
    return [package for package in reduced if package.interfaces]


def leave_out_incomplete(
    packages: Sequence[MessagePackage], installed: Collection[tuple[str, str]]
) -> tuple[list[MessagePackage], Mapping[tuple[str, str], Sequence[tuple[str, str]]]]:
    """Leave out the interfaces that contain messages that exist nowhere.

    Args:
        installed: The messages that are installed, as `(package, name)`.

    Returns:
        The packages without these interfaces, in the order in which they can be built, and what is left out:
        the missing messages by package and interface.

    Raises:
        RosError: Packages need each other.
    """
    incomplete: dict[tuple[str, str], Sequence[tuple[str, str]]] = {}
    complete = list(packages)
    while True:
        known = {(package.name, interface.name) for package in complete for interface in package.interfaces}
        known |= set(installed)
        missing = {
            (package.name, interface.name): sorted(interface.needs - known)
            for package in complete
            for interface in package.interfaces
            if not interface.needs <= known
        }
        if not missing:
            return _in_order([package for package in complete if package.interfaces]), incomplete
        incomplete |= missing
        complete = [
            replace(
                package,
                interfaces=tuple(
                    interface
                    for interface in package.interfaces
                    if (package.name, interface.name) not in missing
                ),
            )
            for package in complete
        ]


def _in_order(packages: Sequence[MessagePackage]) -> list[MessagePackage]:
    """Return *packages* in an order in which each follows those that it needs."""
    by_name = {package.name: package for package in packages}
    graph = {package.name: sorted(package.needs & by_name.keys()) for package in packages}
    try:
        return [by_name[name] for name in TopologicalSorter(graph).static_order()]
    except CycleError as error:
        raise RosError(f"these packages need each other: {' → '.join(error.args[1])}") from None
