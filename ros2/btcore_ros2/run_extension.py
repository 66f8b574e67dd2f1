"""The extension of `btcore run` that provides ROS 2: the session for leaves, and the robot over topics."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from btcore import Tree
from btcore.run_extension import RunExtension
from btcore_ros2.errors import RosError
from btcore_ros2.session import RosSession

if TYPE_CHECKING:
    from contextlib import AbstractContextManager


class RosExtension(RunExtension):
    """Provides the `RosSession` that leaves require."""

    used_by = "leaf that uses ROS 2"
    options: Sequence[click.Option] = (
        click.Option(
            ["--ros-args"],
            metavar="ARGS",
            help="Arguments of the ROS node, as one text: '-r scan:=/scan_raw -r __ns:=/robot1'.",
        ),
    )

    def __init__(self) -> None:
        self._session: RosSession | None = None

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object]
    ) -> Sequence[object]:
        """Return the session if a leaf requires it; see `RunExtension.provide`."""
        if RosSession not in wanted:
            return ()
        import shlex

        try:
            self._session = RosSession(arguments=shlex.split(settings.get("ros_args") or ""))
        except (RosError, ValueError) as error:
            raise click.UsageError(str(error)) from error
        return (self._session,)

    def attach(
        self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]
    ) -> "AbstractContextManager[object]":
        """Close the session at the end of the run."""
        return self._closed()

    @contextmanager
    def _closed(self) -> Iterator[None]:
        try:
            yield
        finally:
            if self._session is not None:
                self._session.close()
