"""What runs now, in words."""

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
import rerun as rr

from ..picture import RUNNING, STATUS_NAMES, Picture, Ticked
from .moments import Moments
from .rows import Rows, Series

NOW: Final = "now"
_NAMES_AT_MOST: Final = 4


class NowPanel:
    """A few lines: the leaves at work, the tick, the robot's contacts."""

    def __init__(self, rows: Rows, picture: Picture) -> None:
        self._series: Series[str] = rows.series(NOW, documents)
        self._names = [node.name for node in picture.nodes]
        self._leaf = np.array([not node.children for node in picture.nodes])
        self._contacts = ""
        self._shown = ""

    def contacts(self, data: Mapping[str, Any]) -> None:
        """Take the counts of a SceneMoving's *data*."""
        if "collisions" in data:
            self._contacts = f"{data['collisions']} collisions · {data.get('grazes', 0)} grazes"

    def tick(self, event: Ticked, moments: Moments) -> None:
        """The lines as of this tick."""
        at_work = [self._names[at] for at in np.flatnonzero((moments.shown == RUNNING) & self._leaf)]
        text = ", ".join(f"**{name}**" for name in at_work[:_NAMES_AT_MOST])
        if len(at_work) > _NAMES_AT_MOST:
            text += f" and {len(at_work) - _NAMES_AT_MOST} more"
        lines = [
            f"| runs | {text or '–'} |",
            "|:--|:--|",
            f"| root | {STATUS_NAMES[event.status]} |",
            f"| tick | {event.tick} |",
        ]
        if self._contacts:
            lines.append(f"| robot | {self._contacts} |")
        document = "\n".join(lines)
        if document != self._shown:
            self._shown = document
            self._series.add(event.t, event.wall, document)


def documents(values: list[str]) -> Iterable[Any]:
    """Columns of one markdown document a row."""
    return rr.TextDocument.columns(text=values, media_type=["text/markdown"] * len(values))
