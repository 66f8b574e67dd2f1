"""The options of `btcore run` that a page may give a run with the real leaves.

They neither write a file, nor import code, nor open a port: the page's language server adds such options
itself.
"""

import shlex
from collections.abc import Sequence
from typing import Final

from btcore.errors import BtcoreError
from btcore.suggestions import did_you_mean

MAX_TEXT: Final = 2_000
"""Maximum number of characters of the options."""
_FLAGS: Final = frozenset({"--fast", "--lockstep", "--nav2"})
_WITH_VALUE: Final = frozenset(
    f"--{name}"
    for name in (
        *("format", "outcomes", "set", "tick-limit", "until", "rate", "duration", "seed", "record-exclude"),
        *("world", "waypoints", "robot", "camera", "start", "noise", "battery", "fault", "people"),
        *("obstacles", "event", "map", "nav-params", "ros2", "bag"),
    )
)


def parse_options(text: str) -> Sequence[str]:
    """Return the arguments in a line of options, as in a shell. An option and its value are one argument.

    Raises:
        BtcoreError: The line is not valid, or contains an option that a page may not give.
    """
    if len(text) > MAX_TEXT:
        raise BtcoreError(f"the options of a run have at most {MAX_TEXT:,} characters")
    try:
        words = iter(shlex.split(text))
    except ValueError as error:
        raise BtcoreError(f"the options of the run are not valid: {str(error).lower()}") from None
    arguments: list[str] = []
    for word in words:
        name, separator, value = word.partition("=")
        if name in _FLAGS and not separator:
            arguments.append(name)
        elif name in _WITH_VALUE:
            given = value if separator else next(words, None)
            if given is None:
                raise BtcoreError(f"the option {name} needs a value")
            if "\0" in given:
                raise BtcoreError(f"the value of {name} contains a null character")
            arguments.append(f"{name}={given}")
        else:
            hint = did_you_mean(name, _FLAGS | _WITH_VALUE)
            raise BtcoreError(
                f"a page cannot give the option {name[:60]!a}{hint}: start the tree in a terminal, with "
                "--publish groot2, and connect with it"
            )
    return arguments
