"""The monitor's extensions of other commands have the types that these declare, which mypy checks."""

from btcore_monitor.log_viewer import LogViewer
from btcore_monitor.preview_extension import RobotPreview
from btcore_recorder.commands.replay import LogViewer as ReplayExtension
from btcore_studio.preview.live import PreviewExtension

preview: PreviewExtension = RobotPreview()
replay: ReplayExtension = LogViewer()
