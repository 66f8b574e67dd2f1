"""The protocol of an extension of `btcore run`, by which another package provides resources for leaves.

A package offers its extension under the entry point group `btcore.run_extensions`:

    [project.entry-points."btcore.run_extensions"]
    rover = "rover_driver.run_extension:RoverExtension"

The entry point names a class. `btcore run`, `btcore sweep` and the commands that run a program in a
robot's world (`btcore.program_runner`) create one object of it for each run, without arguments, and check
it against `RunExtension` before they use it.
"""

from collections.abc import Collection, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any, Protocol, TypedDict

from btcore.errors import BtcoreError
from btcore.tree.tree import Tree

if TYPE_CHECKING:
    import click


class ExtensionError(BtcoreError):
    """Raised when an installed extension has a member that is missing, misspelled or of the wrong type."""


class OutputError(BtcoreError):
    """Raised when an output of a run, such as a recording, is incomplete, for example on a full disk."""


class ProgramSettings(TypedDict, total=False):
    """Settings that are not options, but are added by btcore's ROS 2 commands.

    Attributes:
        port_hint: The end of the error message for a port that is in use.
        ros_session: The `RosSession` that the command has created already.
        spare_boxes: The number of boxes for events that are triggered during the run.
    """

    port_hint: str
    ros_session: object
    spare_boxes: int


class RunExtension(Protocol):
    """An extension of `btcore run`: its options, the resources that it provides, and its part in a run.

    The methods are called in the order in which they are listed here. *settings* are the options of
    the command by their click names, including those of all extensions, and `ProgramSettings`. A method may
    raise `click.UsageError` for an error in the options: the message is printed and the exit code is 2. Any
    other exception counts as an internal error.

    This is a Protocol instead of an abstract base class so that a package can implement an extension without
    importing btcore; it must then define every member. A class that inherits from `RunExtension` overrides
    only the members that it needs; the others keep the defaults below.

    Examples:
        >>> import click
        >>> from btcore.run_extension import RunExtension
        >>> class Rover:
        ...     pass
        >>> class RoverExtension(RunExtension):
        ...     options = (click.Option(["--rover"], help="The address of the rover."),)
        ...     def provide(self, settings, wanted, provided):
        ...         return [Rover()] if Rover in wanted else []
        >>> RoverExtension().provide({"rover": "10.0.0.7"}, wanted=[Rover], provided=[]) != []
        True
    """

    options: Sequence["click.Option"] = ()
    """The command-line options that the extension adds to `btcore run`."""

    single_run_options: Collection[str] = ()
    """Click names of the *options* that simultaneous runs cannot share: `btcore sweep` rejects them."""

    sweep_options: Mapping[str, "click.Option"] = {}
    """Options that `btcore sweep` has in addition. Each varies one of *options*, by its name without dashes.

    The value of such an option, which its callback returns, is the sequence of the texts that the varied
    option takes in turn, or None. `{"world": click.Option(["--worlds"], callback=parse_worlds)}`
    """

    used_by: str | None = None
    """The leaves without which *options* have no effect, as a noun phrase: "leaf that needs a robot".

    `btcore run` prints a warning if the options are given for a tree without such leaves. None means that
    the options always have an effect. `provide` may change the value, to give the reason for the warning.
    """

    is_fallback: bool = False
    """Whether the extension provides only what no other extension has provided.

    It is called last among the extensions that require nothing, or last among those that require something.
    """

    def takes_over(self, settings: Mapping[str, Any], wanted: Sequence[type]) -> Sequence[type]:
        """Return the types that only this extension provides, because of its options; most return ().

        Called first. The other extensions do not see these types in *wanted*, so that they
        do not create what would not be used, such as a simulated world.

        Args:
            settings: The options of the command.
            wanted: The types that leaves declare as resources.
        """
        return ()

    def requires(self, wanted: Sequence[type]) -> Sequence[type]:
        """Return the types of the resources that the extension itself needs to provide for *wanted*.

        Called before `provide` of any extension, and again when another extension requires more. Extensions
        that require nothing provide their resources first, then those that require something.

        Args:
            wanted: The types that leaves declare as resources, and those that extensions require.
        """
        return ()

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object]
    ) -> Sequence[object]:
        """Return resources for leaves; () if *wanted* has no type of this extension.

        Called once, before the tree is created: the place to check options. The first resource of all
        extensions that has an attribute `clock` other than None determines the clock of the tree.

        Args:
            settings: The options of the command.
            wanted: The types that leaves declare as resources, and those that extensions require.
            provided: The resources of the extensions that were called earlier.

        Raises:
            click.UsageError: An option has an invalid value.
        """
        return ()

    def attach(
        self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]
    ) -> AbstractContextManager[object]:
        """Return a context that is entered before the first tick, and exited after the tree was halted.

        The contexts of extensions that provided something are entered first and exited last.

        Args:
            tree: The tree of the run.
            resources: The resources of all extensions.
            settings: The options of the command.

        Raises:
            click.UsageError: The tree cannot be run with these options.
            click.ClickException: On exit: the run could not continue. The message is printed, and the exit
                code is 2.
            OutputError: On exit: an output is incomplete. The summary is printed, and the exit code is 4.
        """
        return nullcontext()

    def replace_tree(self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]) -> None:
        """Continue with *tree*, which was created from a saved file (`--watch`).

        Called between two ticks, after the previous tree was halted.

        Args:
            tree: The new tree, not yet ticked.
            resources: The resources of all extensions, the same as before.
            settings: The options of the command.
        """
        return

    def on_interrupt(self) -> None:
        """Handle the end of the run by Ctrl-C or a signal. The context of `attach` is exited afterwards."""
        return

    def report(self) -> Mapping[str, object]:
        """Return the results for the summary and for `--json`, by heading; {} if there are none.

        Called once, after the context of `attach` was exited. The values must be JSON data; dictionaries
        under the same heading are merged.
        """
        return {}
