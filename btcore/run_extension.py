"""The protocol of an extension of ``btcore run``, by which another package provides resources for leaves.

A package offers its extension under the entry point group ``btcore.resources``::

    [project.entry-points."btcore.resources"]
    rover = "rover_driver.run_extension:RoverExtension"

The entry point names a class. ``btcore run``, ``btcore sweep`` and the commands that run a program in a
robot's world (`btcore.program_runner`) create one object of it for each run, without arguments, and check
it against :class:`RunExtension` before they use it.
"""

from collections.abc import Collection, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any, Protocol

from btcore.errors import BtcoreError
from btcore.tree.tree import Tree

if TYPE_CHECKING:
    import click


class ExtensionError(BtcoreError):
    """An installed extension can't be used: a hook is missing, misspelled or takes other arguments."""


class RunExtension(Protocol):
    """An extension of ``btcore run``: its options, what it provides for leaves, and its part in a run.

    The hooks of a run are called in the order in which they are listed here. *settings* are the options of
    the command by their click names, those of all extensions included. A hook may raise `click.UsageError`
    for a mistake in the options: the message is printed and the exit code is 2. Any other exception counts
    as an internal error.

    A Protocol and not an abstract base class, since a package may implement an extension without importing
    btcore; it then has to have every hook. A class that inherits from this one overrides only the hooks
    that it needs: the others have the defaults below. Either way every hook exists, so that callers look
    up none by its name.
    """

    options: Sequence["click.Option"] = ()
    """The command-line options that the extension adds to ``btcore run``."""

    single_run_options: Collection[str] = ()
    """Click names of those *options* that several runs at a time can't have: a sweep refuses them."""

    used_by: str | None = None
    """The leaves without which *options* have no effect, as a noun phrase: "leaf that asks for a robot".

    ``btcore run`` warns of options that are given for a tree without such leaves. None: the options always
    have an effect.
    """

    is_fallback: bool = False
    """Whether the extension is to provide only what no other extension has provided: it is called last."""

    def requires(self, wanted: Sequence[type]) -> Sequence[type]:
        """Return the further types that the extension needs for its part of *wanted*; () if none.

        Called once, before any extension provides. An extension that requires something provides after
        those that require nothing.

        Args:
            wanted: The types that leaves declare as resources, and those that other extensions require.
        """
        return ()

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object]
    ) -> Sequence[object]:
        """Return resources for leaves; () if *wanted* has no type of this extension.

        Called once, before the tree is made: the place to check options. The first resource of all
        extensions with an attribute ``clock`` that is not None sets the tree's time.

        Args:
            settings: The options of the command.
            wanted: The types that leaves declare as resources, and those that extensions require.
            provided: The resources of the extensions that were called before.

        Raises:
            click.UsageError: An option has an invalid value.
        """
        return ()

    def attach(
        self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]
    ) -> AbstractContextManager[object]:
        """Return a context that is entered before the first tick, and left after the tree was halted.

        Extensions that provided something enter before those that did not, and leave after them.

        Args:
            tree: The tree of the run.
            resources: The resources of all extensions.
            settings: The options of the command.

        Raises:
            click.UsageError: The tree can't be run with these options.
        """
        return nullcontext()

    def replace_tree(self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]) -> None:
        """Continue with *tree*, which was made from a saved file (``--watch``).

        Called between two ticks, after the previous tree was halted.

        Args:
            tree: The new tree, not yet ticked.
            resources: The resources of all extensions, the same as before.
            settings: The options of the command.
        """
        return

    def on_interrupt(self) -> None:
        """Note that Ctrl-C or a signal has ended the run; the context of `attach` is left next."""
        return

    def report(self) -> Mapping[str, object]:
        """Return the results for the summary and for ``--json``, by heading; {} if none.

        Called once, after the context of `attach` was left. The values have to be JSON data; dictionaries
        under the same heading are merged.
        """
        return {}
