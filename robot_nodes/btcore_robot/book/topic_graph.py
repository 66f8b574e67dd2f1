"""A drawing of the topic graph: components as ellipses, topics as boxes."""

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.components.topics import Topics

_ROW, _WIDTH = 52, 760
_LEFT, _MIDDLE, _RIGHT = 120, 380, 640
_PAPER, _INK, _PROCESS, _TOPIC = (250, 249, 246), (60, 60, 64), (255, 226, 160), (206, 226, 245)
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_graph(topics: Topics) -> NDArray[np.uint8]:
    """Return a picture (RGB) of the topics with at least one publisher and one subscriber.

    Arrows connect the publishers with the topics, and the topics with the subscribers.
    """
    connected = [topic for topic in topics if topic.publishers and topic.subscriptions]
    publishers = _rows([sorted(set(topic.publishers)) for topic in connected])
    subscribers = _rows([sorted({item.owner for item in topic.subscriptions}) for topic in connected])
    lowest = max([*publishers.values(), *subscribers.values(), _y(len(connected) - 1), _ROW])
    image: NDArray[np.uint8] = np.full((lowest + 40, _WIDTH, 3), _PAPER, dtype=np.uint8)
    # Arrows first, so that boxes and ellipses cover their ends.
    for index, topic in enumerate(connected):
        y = _y(index)
        for name in sorted(set(topic.publishers)):
            _arrow(image, (_LEFT + 92, publishers[name]), (_MIDDLE - 128, y))
        for name in sorted({subscription.owner for subscription in topic.subscriptions}):
            _arrow(image, (_MIDDLE + 128, y), (_RIGHT - 92, subscribers[name]))
    for index, topic in enumerate(connected):
        y = _y(index)
        cv2.rectangle(image, (_MIDDLE - 126, y - 14), (_MIDDLE + 126, y + 14), _TOPIC, -1)
        cv2.rectangle(image, (_MIDDLE - 126, y - 14), (_MIDDLE + 126, y + 14), _INK, 1)
        _label(image, topic.name, _MIDDLE, y)
    for x, names in ((_LEFT, publishers), (_RIGHT, subscribers)):
        for name, y in names.items():
            cv2.ellipse(image, (x, y), (90, 17), 0, 0, 360, _PROCESS, -1, cv2.LINE_AA)
            cv2.ellipse(image, (x, y), (90, 17), 0, 0, 360, _INK, 1, cv2.LINE_AA)
            _label(image, name, x, y)
    return image


def _rows(names: list[list[str]]) -> dict[str, int]:
    """Return the y (pixels) of each component: the mean y of its topics, moved down to avoid overlaps."""
    places: dict[str, list[int]] = {}
    for index, group in enumerate(names):
        for name in group:
            places.setdefault(name, []).append(_y(index))
    rows: dict[str, int] = {}
    lowest = 0
    for name, heights in sorted(places.items(), key=lambda item: (sum(item[1]) / len(item[1]), item[0])):
        rows[name] = max(round(sum(heights) / len(heights)), lowest)
        lowest = rows[name] + 40
    return rows


def _y(index: int) -> int:
    return 20 + _ROW // 2 + index * _ROW


def _arrow(image: NDArray[np.uint8], start: tuple[int, int], end: tuple[int, int]) -> None:
    length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    cv2.arrowedLine(image, start, end, _INK, 1, cv2.LINE_AA, 0, 10.0 / max(length, 20.0))


def _label(image: NDArray[np.uint8], text: str, x: int, y: int) -> None:
    (width, height), _ = cv2.getTextSize(text, _FONT, 0.42, 1)
    cv2.putText(image, text, (x - width // 2, y + height // 2), _FONT, 0.42, _INK, 1, cv2.LINE_AA)
