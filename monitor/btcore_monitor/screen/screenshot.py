"""Pictures of a recording without a display. The viewer renders with Vulkan, in hardware or software."""

import contextlib
import io
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image
from rerun.chunk import RrdReader

from btcore_monitor.screen.panels import TICK_MS
from btcore_monitor.screen.row_buffer import TREE_TIME, WALL_TIME
from btcore_monitor.screen.viewer_process import ScreenError, ViewerProcess, free_port

if TYPE_CHECKING:
    from rerun.experimental import View, ViewerClient

FULL_HD: Final = (1920, 1080)
_LOAD_WITHIN: Final = 120.0
_DATA_WITHIN: Final = 10.0
"""Timeout (s) for the first data of a recording that is not loading any more."""
_FINISH_WITHIN: Final = 240.0
"""Timeout (s) for the viewer, which may also stop answering requests."""
_SETTLE_WITHIN: Final = 60.0
"""Timeout (s) for a stable picture; long, because software rendering on a busy machine is slow."""
_TOP_BAR: Final = 37
"""Height (pixels) of the window's bar above the views, which has no content in a picture."""
_EQUAL: Final = 3
_STILL_FOR: Final = 0.7
"""Number of consecutive equal pictures, and time (s) without a change, after which a picture is stable."""


def screenshot(
    recording: Path,
    picture: Path,
    t: float | None = None,
    size: tuple[int, int] = FULL_HD,
    view: str | None = None,
) -> None:
    """Write a picture of a recording.

    Args:
        recording: The recording (`.rrd`).
        picture: The PNG file to write.
        t: Tree time (s), or None for the last tick: after it, a run halts its tree. In a recording of several
            robots, the time since its beginning.
        size: Width and height (pixels).
        view: The name of a view, or its beginning, to show instead of the whole window.

    Raises:
        ScreenError: There is no Vulkan driver, no such file or view, or the viewer does not answer.
    """
    if not recording.is_file():
        raise ScreenError(f"there is no recording {recording}")
    with _viewer(size) as client:
        client.open([str(recording.resolve())])
        views = _wait_for_views(client)
        # The bar has warnings about the computer: of its graphics, for example.
        client.run_command("ui.toggle_top_panel")
        chosen = None
        if view is not None:
            chosen = next((known.view_id for known in views if known.name.startswith(view)), None)
            if chosen is None:
                names = ", ".join(sorted(known.name for known in views))
                raise ScreenError(f"there is no view {view!r} in the recording; views are: {names}")
        _set_time(client, t, recording)
        shot = _settled(client, chosen)
    picture.write_bytes(shot if view is not None else _without_top_bar(shot))


def _without_top_bar(picture: bytes) -> bytes:
    """Remove the empty bar above the views from the picture of a window."""
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


def _set_time(client: "ViewerClient", t: float | None, recording: Path) -> None:
    """Set the time cursor to *t* on the window's timeline: tree time, or wall time for several robots."""
    recordings = client.get_state().recordings
    timelines = [timeline for recording in recordings for timeline in recording.timelines]
    if any(recording.current_timeline == WALL_TIME for recording in recordings):
        wall = None if t is not None else last_tick(recording, WALL_TIME)
        spans = [(timeline.start, timeline.end) for timeline in timelines if timeline.name == WALL_TIME]
        if t is not None:
            wall = min((start for start, _ in spans if start is not None), default=0) + round(t * 1e9)
        elif wall is None:
            wall = max((end for _, end in spans if end is not None), default=0)
        client.set_time(WALL_TIME, timestamp=np.datetime64(wall, "ns"), play_state="paused")
        return
    last = round(t * 1e9) if t is not None else last_tick(recording, TREE_TIME)
    if last is None:
        ends = [line.end for line in timelines if line.name == TREE_TIME and line.end is not None]
        last = max(ends, default=0)
    client.set_time(TREE_TIME, duration=np.timedelta64(last, "ns"), play_state="paused")


@contextlib.contextmanager
def _viewer(size: tuple[int, int]) -> Iterator["ViewerClient"]:
    """Run a viewer without a window until the end of the `with` block."""
    from rerun.experimental import ViewerClient

    window = f"--window-size={size[0]}x{size[1] + _TOP_BAR}"
    viewer = ViewerProcess(
        "--headless", "--hide-welcome-screen", window, "--memory-limit=1GB", port=free_port()
    )
    watchdog = threading.Timer(_FINISH_WITHIN, viewer.kill)
    watchdog.start()
    try:
        viewer.wait_until_listening()
        yield ViewerClient.connect(viewer.address)
    except ConnectionError as error:
        reason = viewer.failure() or "it does not answer"
        raise ScreenError(f"the viewer (rerun) failed while it drew the picture: {reason}") from error
    finally:
        watchdog.cancel()
        viewer.close()


def _wait_for_views(client: "ViewerClient") -> "list[View]":
    now = loading_at = time.monotonic()
    deadline = now + _LOAD_WITHIN
    while now < deadline:
        state = client.get_state()
        timelines = {timeline.name for recording in state.recordings for timeline in recording.timelines}
        if state.views and TREE_TIME in timelines and not state.loading:
            return list(state.views)
        time.sleep(0.1)
        now = time.monotonic()
        if state.loading or not state.recordings:
            loading_at = now
        elif now - loading_at > _DATA_WITHIN:
            raise ScreenError("the recording is not one of btcore's monitor, or it has no data")
    raise ScreenError(f"the recording did not load within {_LOAD_WITHIN:.0f} s")


def _settled(client: "ViewerClient", view_id: str | None) -> bytes:
    """Return the picture once it is stable; layout, fonts and late data take a few frames."""
    deadline = time.monotonic() + _SETTLE_WITHIN
    last, equal, since = b"", 0, time.monotonic()
    while time.monotonic() < deadline:
        # The viewer does not report that it has finished drawing, so pictures are compared.
        shot = client.take_screenshot(view_id)
        now = time.monotonic()
        if shot != last:
            last, equal, since = shot, 0, now
        equal += 1
        if equal >= _EQUAL and now - since >= _STILL_FOR:
            break
    return last
