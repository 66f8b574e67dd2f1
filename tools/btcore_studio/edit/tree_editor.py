"""Operations on the nodes of a tree."""

import re
from collections.abc import Collection
from typing import Final

from btcore.names import is_port_name
from btcore.xml.edit.editor import DocumentEditor, Edit, EditError
from btcore.xml.read.scan import ScannedElement
from btcore.xml.read.tags import EXPLICIT_TAGS, SUBTREE_TAGS

# `_skipIf` of a disabled node; the original condition is in the parentheses.
_DISABLED: Final = re.compile(r"true(?: \|\| \((.*)\))?", re.DOTALL)


def is_disabled(condition: str | None) -> bool:
    """Return whether *condition* is the `_skipIf` of a disabled node."""
    return condition is not None and _DISABLED.fullmatch(condition) is not None


class TreeEditor(DocumentEditor):
    """Makes edits of a document from operations on the nodes of its trees."""

    def change_type(self, element: ScannedElement, id: str, ports: Collection[str]) -> list[Edit]:
        """Make an element a node of another type.

        Args:
            element: The element of the node.
            id: The ID of the new type.
            ports: The ports of the new type; attributes of other ports are removed.
        """
        names = dict.fromkeys(item.name for item in element.attributes)
        removed = [name for name in names if is_port_name(name) and name not in ports]
        if element.tag in SUBTREE_TAGS[3]:  # also the tag of format 4
            removed = [name for name in names if name == "ID" or name in removed]
        edits = [self.remove_attribute(element, name) for name in removed]
        if element.tag in EXPLICIT_TAGS:
            return [self.set_attribute(element, "ID", id), *edits]
        return [*self.rename_element(element, id), *edits]

    def disable(self, element: ScannedElement) -> Edit:
        """Let an element of format 4 be skipped, by its pre-condition `_skipIf`.

        Raises:
            EditError: The element is disabled already.
        """
        condition = element.get("_skipIf")
        if is_disabled(condition):
            raise EditError(f"<{element.tag}> is disabled already")
        disabled = "true" if not condition else f"true || ({condition})"
        return self.set_attribute(element, "_skipIf", disabled)

    def enable(self, element: ScannedElement) -> Edit:
        """Undo `disable`.

        Raises:
            EditError: The element is not disabled.
        """
        match = _DISABLED.fullmatch(element.get("_skipIf") or "")
        if match is None:
            raise EditError(f"<{element.tag}> is not disabled")
        if match[1] is None:
            return self.remove_attribute(element, "_skipIf")
        return self.set_attribute(element, "_skipIf", match[1])

    def unwrap(self, element: ScannedElement) -> list[Edit]:
        """Put the children of an element in its place.

        Raises:
            EditError: The element has no children.
        """
        if not element.children:
            raise EditError(f"<{element.tag}> has no children")
        text = self.text
        start = element.start_tag_end
        while text[start].isspace():
            start += 1
        # An end tag can be missing.
        end = self.before_space(element.end_tag_start) if element.end_tag_start >= 0 else element.end
        edits = [Edit(element.start, start, ""), Edit(end, element.end, "")]
        own, inner = self.indent(element), self.indent_at(start)
        if own is not None and inner is not None:
            edits[1:1] = self.reindent(start, end, inner, own)
        return edits
