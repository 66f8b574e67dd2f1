"""The fixes of diagnostics: changes of a document, described without its text.

The stages of loading know elements and names, but not the text around them: `btcore.xml.edit.quick_fixes`
makes edits of the text from these descriptions.
"""


# Not dataclasses: creating as many would take as long as the rest of `import btcore`.
class Fix:
    """A change at the place of a diagnostic that removes its cause. Each kind of change is a subclass.

    Attributes:
        is_safe: Whether the change needs no decision of a person: the document means the same as before, or
            it was invalid and can mean nothing else. `btcore validate --fix` applies these changes.
    """

    def __init__(self, *, is_safe: bool = False) -> None:
        self.is_safe = is_safe

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={value!r}" for name, value in vars(self).items())
        return f"{type(self).__name__}({values})"

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash((type(self), *vars(self).values()))


class _FixWithText(Fix):
    """A fix with a new name or text."""

    def __init__(self, text: str, *, is_safe: bool = False) -> None:
        super().__init__(is_safe=is_safe)
        self.text = text


# --- names, values and characters


class Rename(_FixWithText):
    """Replace the marked name: a tag, an attribute, an ID, or a key in braces or in a script."""


class RenameElement(_FixWithText):
    """Change the tag of the marked element, and its end tag."""


class RenameAttribute(_FixWithText):
    """Rename the attribute whose value is marked, unless the element has an attribute of this name."""


class ReplaceText(_FixWithText):
    """Replace the marked characters by a text, which is escaped already."""


class Escape(Fix):
    """Escape all markup characters in the marked value."""


class SetValue(Fix):
    """Replace the marked value. Of several values, the most similar comes first."""

    def __init__(self, *values: str, is_safe: bool = False) -> None:
        super().__init__(is_safe=is_safe)
        self.values = values


class SetAttributes(Fix):
    """Give attributes of the marked element values."""

    def __init__(self, values: dict[str, str]) -> None:
        super().__init__()
        self.values = tuple(values.items())


class SetFormat(Fix):
    """Write the XML format in the root element."""

    def __init__(self, format: int) -> None:
        super().__init__()
        self.format = format


class CreateEntry(Fix):
    """Change the assignment after the marked key, which creates the entry then."""


class RemoveAttribute(Fix):
    """Remove the marked attribute."""


class RemoveElement(Fix):
    """Remove the marked element."""


class CloseTag(Fix):
    """Close the marked tag, which is cut off."""


class WriteEndTag(_FixWithText):
    """Write the end tag of an element instead of the marked end tag, or before it."""


# --- trees and models


class NameTree(Fix):
    """Give the marked <BehaviorTree> an ID that no tree of the text has."""


class CreateTree(_FixWithText):
    """Add a tree with this ID and one node to the document."""


class CallTree(Fix):
    """Make the marked element a SubTree element that calls the tree with its name."""


class Connect(Fix):
    """Connect *key* in the element with the number *index*, which calls *tree*, with *value*."""

    def __init__(self, index: int, tree: str, key: str, value: str) -> None:
        super().__init__()
        self.index = index
        self.tree = tree
        self.key = key
        self.value = value


class DeclareNode(_FixWithText):
    """Add a model of the node with this ID, which is marked, with its attributes as ports."""


# --- children


class AddChildren(Fix):
    """Add *count* leaves after the children of the marked element."""

    def __init__(self, count: int) -> None:
        super().__init__()
        self.count = count


class RemoveChildren(Fix):
    """Remove the children of the marked element."""


class WrapChildren(Fix):
    """Put the children of the marked element, from the index *first*, into a new element."""

    def __init__(self, tag: str, first: int) -> None:
        super().__init__()
        self.tag = tag
        self.first = first


def wrapping_fixes(most: int) -> tuple[Fix, ...]:
    """Return the fixes that put the last children into a control node, so that *most* are left."""
    return tuple(WrapChildren(tag, most - 1) for tag in ("Sequence", "Fallback"))
