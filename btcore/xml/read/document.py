"""A document, which makes the diagnostics about its elements."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, TypedDict, Unpack

from btcore.diagnostic_codes import DiagnosticCode
from btcore.diagnostics import Diagnostic
from btcore.fixes import Fix
from btcore.input_files import real_path
from btcore.xml.read.element import Element, ElementPart

if TYPE_CHECKING:
    # Imported where it is used: a correct document with one-line tags does not need it.
    from btcore.xml.read.positions import SourceMap


class Mark(TypedDict, total=False):
    """What a diagnostic marks: the element itself, or with *attribute* one of its attributes.

    Attributes:
        attribute: Name of the attribute; "" means the element itself.
        part: Whether to mark the attribute's name or its value (default).
        column: Number of a character in the value, from 1; 0 means the whole value.
        width: The number of characters to mark from *column* on; default 1.
    """

    attribute: str
    part: ElementPart
    column: int
    width: int


class Document:
    """One XML document.

    Attributes:
        root: The outermost element.
        text: The text as the user wrote it.
        file: Name of the file in messages, or "".
        warnings: A warning for everything that BehaviorTree.CPP accepts, but other XML tools reject.
        knows_lines: Whether every element has its line number.
        max_depth: Maximum depth of elements below a `<BehaviorTree>`.
        confined_to: The folder that must contain all included files; None means that any file is allowed.
        unsaved: Texts that replace the content of included files, by their `real_path`.
    """

    max_depth: int = 256  # as in BehaviorTree.CPP
    unsaved: Mapping[Path, str] = MappingProxyType({})

    def __init__(
        self,
        root: Element,
        text: str,
        file: str,
        warnings: Sequence[Diagnostic] = (),
        knows_lines: bool = False,
        confined: bool = False,
        source_map: "SourceMap | None" = None,
    ) -> None:
        self.root = root
        self.text = text
        self.file = file
        self.warnings = list(warnings)
        self._source_map = source_map
        self.knows_lines = knows_lines
        self.confined_to = real_path(self.folder) if confined else None

    @property
    def folder(self) -> Path:
        """The folder that paths of includes are relative to.

        It is the folder of the file, or the current folder if the document is not from a file.
        """
        return Path(self.file).parent if self.file else Path()

    @property
    def source_map(self) -> "SourceMap":
        """The positions of the elements, computed on first use, unless the document was created with them."""
        if self._source_map is None:
            from btcore.xml.read.positions import SourceMap

            self._source_map = SourceMap(self.text, self.root)
        return self._source_map

    def line(self, element: Element) -> int:
        """Return the line (from 1) in which *element* begins."""
        return element.line if self.knows_lines else self.source_map.line(element)

    def diagnostic(
        self,
        code: DiagnosticCode,
        message: str,
        element: Element,
        hint: str = "",
        fixes: Sequence[Fix] = (),
        **mark: Unpack[Mark],
    ) -> Diagnostic:
        """Return a diagnostic about an element or one of its attributes; see `Diagnostic` and `Mark`."""
        span = self.source_map.span(element, **mark)
        start = mark.get("column", 0) - 1
        characters = (start, start + mark.get("width", 1)) if start >= 0 else (0, 0)
        attribute = mark.get("attribute", "")
        return span.diagnostic(code, message, self.file, hint, fixes, attribute, characters)
