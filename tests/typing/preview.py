"""The monitor's extension of `btcore preview` has the types that the preview declares, which mypy checks."""

from btcore_monitor.preview_extension import RobotPreview
from btcore_studio.preview.live import PreviewExtension

extension: PreviewExtension = RobotPreview()
