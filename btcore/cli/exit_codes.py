"""What the command line exits with; 0 is that all went well."""

from typing import Final

FAILURE: Final = 1
"""A tree failed, or something else that was asked is not so."""
USER_ERROR: Final = 2
"""The user's, in a tree or on the command line."""
RAISED: Final = 3
"""A leaf raised."""
INTERNAL_ERROR: Final = 70
"""btcore itself failed; EX_SOFTWARE of sysexits.h."""
INTERRUPTED: Final = 130
