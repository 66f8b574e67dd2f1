"""The extension of `btcore run` that publishes a run on topics of ROS 2: `--ros2-publish`."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

import click

from btcore import Tree
from btcore.run_extension import RunExtension
from btcore_ros2.errors import RosError
from btcore_ros2.session import node_arguments
from btcore_ros2.telemetry import TOPICS, RosTelemetry, check_topics


class TelemetryExtension(RunExtension):
    """Adds the option `--ros2-publish`."""

    options: Sequence[click.Option] = (
        click.Option(
            ["--ros2-publish"],
            type=click.Choice(TOPICS),
            multiple=True,
            help="Publish the run for ROS 2: transitions on /behavior_tree_log, the state of the tree on "
            "/diagnostics, or log records on /rosout; may be given several times.",
        ),
    )
    single_run_options = ("ros2_publish",)

    def __init__(self) -> None:
        self._telemetry: RosTelemetry | None = None

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object]
    ) -> Sequence[object]:
        """Check that the messages are installed. Return no resources."""
        try:
            check_topics(settings.get("ros2_publish") or ())
        except RosError as error:
            raise click.UsageError(f"--ros2-publish: {error}.") from error
        return ()

    def attach(
        self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]
    ) -> AbstractContextManager[object]:
        """Publish the run; see `RunExtension.attach`."""
        if not settings.get("ros2_publish"):
            return nullcontext()
        self.replace_tree(tree, resources, settings)
        return self._closing()

    def replace_tree(self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]) -> None:
        """Publish *tree* instead of the previous tree."""
        topics = settings.get("ros2_publish")
        if not topics:
            return
        if self._telemetry is not None:
            self._telemetry.close()
        try:
            self._telemetry = RosTelemetry(tree, topics, arguments=node_arguments(settings.get("ros_args")))
        except (RosError, ValueError) as error:
            raise click.UsageError(str(error)) from error

    @contextmanager
    def _closing(self) -> Iterator[None]:
        try:
            yield
        finally:
            if self._telemetry is not None:
                self._telemetry.close()
