"""Links to the studio in the browser, whose fragments hold files: `page/src/site/link.ts` reads them."""

import base64
import json
import re
import unicodedata
import zlib
from collections.abc import Mapping
from typing import Final

from btcore.documentation_site import FIRST_PAGE
from btcore.errors import BtcoreError

ADDRESS: Final = f"{FIRST_PAGE}studio/"
MAX_FRAGMENT: Final = 1_000_000
MAX_CONTENT: Final = 4 << 20
MAX_FILES: Final = 32

_MARK: Final = "\ufeff"
_MAX_NAME: Final = 100
_NAME: Final = re.compile(r'[^/\\:*?"<>|.][^/\\:*?"<>|]*\.(xml|btproj)')


def link_to(
    files: Mapping[str, str], *, tree: str | None = None, recording: str | None = None, address: str = ADDRESS
) -> str:
    """Return a link that opens files in the studio in the browser, and runs nothing.

    Args:
        files: The text of each file, by name. The first file is shown.
        tree: The ID of the tree that is shown; default the main tree of the first file.
        recording: The text of a recording (`.btrec.txt`) of the first file's tree.
        address: The address of the page.

    Raises:
        BtcoreError: The page would refuse the link: a name or text is invalid, or the files are too large.

    Examples:
        >>> from btcore_studio.site.links import link_to
        >>> link_to({"tree.xml": "<root/>"}, address="studio/")[:20]
        'studio/#files=q1ZKy8'
    """
    if not 1 <= len(files) <= MAX_FILES:
        raise BtcoreError(f"a link contains from 1 to {MAX_FILES} files")
    for name in files:
        is_printable = not any(unicodedata.category(character).startswith("C") for character in name)
        if not (is_printable and _NAME.fullmatch(name) and len(name.encode("utf-16-le")) <= 2 * _MAX_NAME):
            raise BtcoreError(f"{name!r} is not the name of a file that ends with .xml or .btproj")
    content: dict[str, object] = {
        "files": [
            {"name": name, "text": text.removeprefix(_MARK), **({"mark": True} if text[:1] == _MARK else {})}
            for name, text in files.items()
        ]
    }
    content |= {} if tree is None else {"tree": tree}
    content |= {} if recording is None else {"recording": recording}
    try:
        data = json.dumps(content, ensure_ascii=False, separators=(",", ":")).encode()
    except UnicodeEncodeError:
        raise BtcoreError("the files contain characters that are not in Unicode") from None
    packed = zlib.compress(data, 9, wbits=-zlib.MAX_WBITS)
    fragment = "#files=" + base64.urlsafe_b64encode(packed).decode().rstrip("=")
    if len(data) > MAX_CONTENT or len(fragment) > MAX_FRAGMENT:
        raise BtcoreError("the files are too large for a link")
    return address + fragment
