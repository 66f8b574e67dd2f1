"""Turn the SVG drawing of a tree into a PNG, with the library resvg."""

import re
from typing import Final

from btcore.errors import BtcoreError
from btcore.extras import install_command
from btcore.xml.render.svg import drawing_style

MAX_SIDE: Final = 2400
"""The maximum width and height of a picture (pixels); a larger drawing is made smaller."""

_SCALE: Final = 1.5
_MIN_SCALE: Final = 0.6  # smaller texts cannot be read
_SIZE: Final = re.compile(r'<svg [^>]*?width="(\d+)" height="(\d+)"')


class PictureError(BtcoreError):
    """Raised if a drawing cannot become a picture."""


def svg_to_png(svg: str) -> bytes:
    """Return a drawing of `diagram_to_svg` as a PNG.

    The picture uses the fonts of the machine: the first that the drawing names, and others for characters
    that it lacks. A character that no font has is an empty box.

    Raises:
        PictureError: The package resvg_py is not installed, the drawing is too large for a picture in which
            texts can be read, or the machine has none of the fonts.
    """
    try:
        import resvg_py
    except ModuleNotFoundError:
        raise PictureError(f"a PNG needs the package resvg_py: {install_command('resvg_py')}") from None
    size = _SIZE.match(svg)
    assert size is not None, "a drawing begins with its size"
    width, height = int(size[1]), int(size[2])
    scale = min(_SCALE, MAX_SIDE / max(width, height))
    if scale < _MIN_SCALE:
        raise PictureError(
            f"the drawing is too large for a PNG in which texts can be read ({width} × {height} px); draw a "
            "subtree, or an SVG"
        )
    # resvg silently omits a text without a font.
    letter, space = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="20" height="20"><style>{drawing_style()}</style>'
        f'<text y="15">{text}</text></svg>'
        for text in "x "
    )
    if resvg_py.svg_to_bytes(letter) == resvg_py.svg_to_bytes(space):
        raise PictureError("a PNG needs a font such as DejaVu Sans, which is not installed")
    return resvg_py.svg_to_bytes(svg, zoom=scale)
