"""The extensions of tools have the types that the tools declare, which mypy checks."""

from collections.abc import Callable
from pathlib import Path

from btcore.xml.plan.plan import Plans
from btcore_monitor.live_extension import RobotExtension
from btcore_monitor.log_viewer import LogViewer
from btcore_proof.outcome_replay import OutcomesReader
from btcore_proof.page_questions import answer_questions
from btcore_recorder.commands.replay import LogViewer as ReplayExtension
from btcore_recorder.mock_run import MockRun
from btcore_recorder.moments import Moments
from btcore_recorder.outcomes import read_outcomes
from btcore_recorder.run_text import record_run
from btcore_studio.language.live import LiveExtension
from btcore_studio.language.mock_runs import MockRun as PageRun
from btcore_studio.language.proofs import RecordRun, Search
from btcore_studio.language.timeline import Timeline

live: LiveExtension = RobotExtension()
replay: ReplayExtension = LogViewer()
timeline: Callable[[Path], Timeline] = Moments
run: Callable[[Plans, float], PageRun] = MockRun
search: Search = answer_questions
record: RecordRun = record_run
outcomes: OutcomesReader = read_outcomes
