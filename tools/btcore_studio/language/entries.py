"""The facts about blackboard entries that hovers, hints and completion show: types, writers and readers."""

from collections.abc import Iterable
from typing import NamedTuple

from btcore.values import ValueType
from btcore_studio.language.key_links import KeyLinks, TreeKey
from btcore_studio.language.symbols import KeyForm, KeyUse, TreeSymbol, node_id


class EntryFacts(NamedTuple):
    """What is known about an entry.

    Attributes:
        keys: The keys under which the outermost calling trees know the entry.
        type: The type that ports declare, preferably of a writing port; None if no port declares a type.
        writers: The places that write the entry, in all trees.
        readers: The places that read the entry, in all trees.
    """

    keys: list[TreeKey]
    type: ValueType | None
    writers: list[KeyUse]
    readers: list[KeyUse]


def entry_facts(links: KeyLinks, keys: Iterable[TreeKey]) -> EntryFacts:
    """Return the facts about the entry that *keys* name.

    Args:
        links: The connections of the keys of the project.
        keys: A key, or the keys that one place of a document names.
    """
    keys = list(keys)
    uses = links.entry_uses(keys)
    writers = [use for use in uses if use.writes]
    types = (port_type(links, use) for use in (*writers, *uses))
    entry_type = next((entry_type for entry_type in types if entry_type is not None), None)
    return EntryFacts(links.outermost_keys(keys), entry_type, writers, [use for use in uses if use.reads])


def keys_of(links: KeyLinks, tree: TreeSymbol) -> dict[str, list[KeyUse]]:
    """Return the keys of the blackboard of *tree*, each with the places that name it."""
    return {key.key: uses for key, uses in links.uses.items() if key.tree is tree}


def port_type(links: KeyLinks, use: KeyUse) -> ValueType | None:
    """Return the type of the port that *use* sets to a key; None if it is no port, or accepts any value."""
    if use.form in (KeyForm.SCRIPT, KeyForm.ATTRIBUTE, KeyForm.MODEL):
        return None
    format = links.symbols.files[use.file].format
    manifest = links.symbols.registry.get(node_id(use.element), format)
    port = manifest.ports.get(use.port) if manifest is not None else None
    return port.type if port is not None and port.type.strong else None
