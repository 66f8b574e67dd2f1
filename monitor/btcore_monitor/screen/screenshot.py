"""Pictures of a recording without a display. The viewer renders with Vulkan, in hardware or software."""

import contextlib
import io
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np
from PIL import Image
from rerun.chunk import RrdReader

from btcore_monitor.screen.panels import TICK_MS
from btcore_monitor.screen.rerun_process import RerunProcess, ScreenError
from btcore_monitor.screen.row_buffer import TREE_TIMELINE, WALL_TIMELINE

if TYPE_CHECKING:
    from rerun.experimental import View, ViewerState

T = TypeVar("T")

FULL_HD: Final = (1920, 1080)
# The viewer answers a request when it has drawn a frame. On a busy machine it needs many times as long for a
# frame, but not more frames. So the limits count answers, and a time limit applies only to a single answer.
_ANSWER_TIMEOUT_S: Final = 300.0
"""Timeout (s) for an answer of the viewer, after which the viewer is killed."""
_LOAD_ANSWERS: Final = 3000
"""Greatest number of answers while a recording loads."""
_DATA_ANSWERS: Final = 80
"""Greatest number of answers without data after a recording has loaded."""
_MAX_PICTURES: Final = 200
"""Greatest number of pictures until one is stable; the last picture is used otherwise."""
_TOP_BAR: Final = 37
"""Height (pixels) of the window's bar above the views, which is not part of a picture."""
_EQUAL: Final = 3
_STILL_FOR: Final = 0.7
"""Number of consecutive equal pictures, and time (s) without a change, after which a picture is stable."""


def write_screenshot(
    recording: Path,
    picture: Path,
    at: float | None = None,
    size: tuple[int, int] = FULL_HD,
    view: str | None = None,
) -> None:
    """Write a picture of a recording.

    Args:
        recording: The recording (`.rrd`).
        picture: The PNG file to write.
        at: Tree time (s), or None for the last tick: after it, a run halts its tree. In a recording of
            several robots, the time since its beginning.
        size: Width and height (pixels).
        view: The name of a view, or its beginning, to show instead of the whole window.

    Raises:
        ScreenError: There is no Vulkan driver, no such file or view, or the viewer does not answer.
    """
    if not recording.is_file():
        raise ScreenError(f"there is no recording {recording}")
    with _open_viewer(size) as viewer:
        viewer.open(recording)
        views = _wait_for_views(viewer)
        chosen = None
        if view is not None:
            chosen = next((shown.view_id for shown in views if shown.name.startswith(view)), None)
            if chosen is None:
                names = ", ".join(sorted(shown.name for shown in views))
                raise ScreenError(f"there is no view {view!r} in the recording; views are: {names}")
        _set_time(viewer, at, recording)
        shot = _settled(viewer, chosen)
    picture.write_bytes(shot if view is not None else _remove_top_bar(shot))


def _remove_top_bar(picture: bytes) -> bytes:
    """Remove the bar above the views, which may show warnings about the computer, from a window's picture."""
    cropped = io.BytesIO()
    with Image.open(io.BytesIO(picture)) as image:
        image.crop((0, _TOP_BAR, *image.size)).save(cropped, "PNG")
    return cropped.getvalue()


def last_tick(recording: Path, timeline: str) -> int | None:
    """Return the time (ns) of the last tick on *timeline*, or None if the robot does not report its ticks."""
    last = None
    for chunk in RrdReader(recording).stream():
        if str(chunk.entity_path).endswith(f"/{TICK_MS}") and not chunk.is_static:
            times = chunk.to_record_batch().column(timeline).cast("int64").to_pylist()
            last = max(times if last is None else [*times, last])
    return last


def _set_time(viewer: "_HeadlessViewer", at: float | None, recording: Path) -> None:
    """Set the time cursor to *at* on the window's timeline: tree time, or wall time for several robots."""
    recordings = viewer.state().recordings
    timelines = [timeline for recording in recordings for timeline in recording.timelines]
    if any(recording.current_timeline == WALL_TIMELINE for recording in recordings):
        wall = None if at is not None else last_tick(recording, WALL_TIMELINE)
        spans = [(timeline.start, timeline.end) for timeline in timelines if timeline.name == WALL_TIMELINE]
        if at is not None:
            wall = min((start for start, _ in spans if start is not None), default=0) + round(at * 1e9)
        elif wall is None:
            wall = max((end for _, end in spans if end is not None), default=0)
        viewer.set_time(WALL_TIMELINE, np.datetime64(wall, "ns"))
        return
    last = round(at * 1e9) if at is not None else last_tick(recording, TREE_TIMELINE)
    if last is None:
        ends = [line.end for line in timelines if line.name == TREE_TIMELINE and line.end is not None]
        last = max(ends, default=0)
    viewer.set_time(TREE_TIMELINE, np.timedelta64(last, "ns"))


class _HeadlessViewer:
    """A viewer without a window. It is killed if it does not answer for `_ANSWER_TIMEOUT_S`.

    rerun ends a request after 15 s with TimeoutError. On a busy machine, a frame may take longer. Therefore
    requests are repeated until the viewer answers or is killed; only requests that can be repeated are used.
    """

    def __init__(self, process: RerunProcess) -> None:
        from rerun.experimental import ViewerClient

        self.is_silent = False
        """Whether the viewer was killed because it did not answer."""
        self._process = process
        self._watchdog = self._start_watchdog()
        self._client = ViewerClient.connect(process.address)

    def open(self, recording: Path) -> None:
        """Open *recording*. The viewer loads it in the background."""
        self._answer(lambda: self._client.open([str(recording.resolve())]))

    def set_time(self, timeline: str, time: np.timedelta64 | np.datetime64) -> None:
        """Stop at *time* of *timeline*."""
        if isinstance(time, np.datetime64):
            self._answer(lambda: self._client.set_time(timeline, timestamp=time, play_state="paused"))
        else:
            self._answer(lambda: self._client.set_time(timeline, duration=time, play_state="paused"))

    def state(self) -> "ViewerState":
        """Return the viewer's state."""
        return self._answer(self._client.get_state)

    def picture(self, view_id: str | None) -> bytes:
        """Return a picture (PNG) of the window, or of the view *view_id*."""
        return self._answer(lambda: self._client.take_screenshot(view_id))

    def stop_watching(self) -> None:
        """Let the viewer run without a time limit."""
        self._watchdog.cancel()

    def _answer(self, request: Callable[[], T]) -> T:
        """Return the viewer's answer. Raise ConnectionError if the viewer has ended or does not answer."""
        while True:
            try:
                answer = request()
            except TimeoutError:
                continue
            self._watchdog.cancel()
            self._watchdog = self._start_watchdog()
            return answer

    def _start_watchdog(self) -> threading.Timer:
        watchdog = threading.Timer(_ANSWER_TIMEOUT_S, self._kill)
        watchdog.daemon = True
        watchdog.start()
        return watchdog

    def _kill(self) -> None:
        self.is_silent = True
        self._process.kill()


@contextlib.contextmanager
def _open_viewer(size: tuple[int, int]) -> Iterator[_HeadlessViewer]:
    """Run a viewer without a window until the end of the `with` block."""
    window = f"--window-size={size[0]}x{size[1] + _TOP_BAR}"
    process = RerunProcess("--headless", "--hide-welcome-screen", window, "--memory-limit=1GB")
    viewer = None
    try:
        process.wait_until_listening()
        viewer = _HeadlessViewer(process)
        yield viewer
    except ConnectionError as error:
        if viewer is not None and viewer.is_silent:
            reason = f"it did not answer for {_ANSWER_TIMEOUT_S:.0f} s, and was killed"
        else:
            reason = process.wait_for_failure() or "it does not answer"
        raise ScreenError(f"the viewer (rerun) failed while it drew the picture: {reason}") from error
    finally:
        if viewer is not None:
            viewer.stop_watching()
        process.close()


def _wait_for_views(viewer: _HeadlessViewer) -> "list[View]":
    without_data = 0
    for _ in range(_LOAD_ANSWERS):
        state = viewer.state()
        timelines = {timeline.name for recording in state.recordings for timeline in recording.timelines}
        if state.views and TREE_TIMELINE in timelines and not state.loading:
            return list(state.views)
        without_data = 0 if state.loading or not state.recordings else without_data + 1
        if without_data > _DATA_ANSWERS:
            raise ScreenError("the recording is not one of btcore's monitor, or it has no data")
        time.sleep(0.1)
    raise ScreenError(f"the viewer (rerun) has not loaded the recording after {_LOAD_ANSWERS} frames")


def _settled(viewer: _HeadlessViewer, view_id: str | None) -> bytes:
    """Return the picture once it is stable; layout, fonts and late data take a few frames."""
    last, equal, since = b"", 0, time.monotonic()
    for _ in range(_MAX_PICTURES):
        # The viewer does not report that it has finished drawing, so pictures are compared.
        shot = viewer.picture(view_id)
        now = time.monotonic()
        if shot != last:
            last, equal, since = shot, 0, now
        equal += 1
        if equal >= _EQUAL and now - since >= _STILL_FOR:
            break
    return last
