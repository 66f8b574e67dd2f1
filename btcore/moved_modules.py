"""Modules that were moved, for hints in the errors of plugins that import them by their old names."""

from typing import Final

MOVED_MODULES: Final = {
    "btcore.agents": "btcore_studio.agents",
    "btcore.batch": "btcore_batch",
    "btcore.flatbuffer": "btcore_monitor.wire.flatbuffer",
    "btcore.language": "btcore_studio.language",
    "btcore.lint.data_flow": "btcore_drawing.data_flow",
    "btcore.logs.divergence": "btcore_recorder.divergence",
    "btcore.logs.fbl": "btcore_monitor.logs.fbl",
    "btcore.logs.sqlite": "btcore_monitor.logs.sqlite",
    "btcore.logs.statistics": "btcore_recorder.tree_observer",
    "btcore.logs.trace": "btcore_monitor.logs.trace",
    "btcore.preview": "btcore_studio.preview",
    "btcore.proof": "btcore_proof",
    "btcore.sweep": "btcore_sweep",
    "btcore.xml.convert": "btcore_studio.convert",
    "btcore.xml.lint": "btcore.lint",
    "btcore.xml.models.stubs": "btcore.registry.mock_nodes",
    "btcore.xml.render": "btcore_drawing",
    "btcore.xml.render.tree_xml": "btcore.loading.tree_xml",
    "btcore.xml.schema": "btcore_studio.schema",
    "btcore_monitor.display": "btcore_monitor.environment_checks",
    "btcore_robot.navigation": "btcore_navigation",
    "btcore_robot.navigation.occupancy_map": "btcore_robot.occupancy_map",
    "btcore_robot.navigation.parameter_files": "btcore_robot.parameter_files",
    "btcore_robot.navigation.waypoint_file": "btcore_robot.waypoint_file",
    "btcore_robot.leaves.explore": "btcore_navigation.leaves.explore",
    "btcore_robot.leaves.navigate": "btcore_navigation.leaves.navigate",
    "btcore_robot.process": "btcore_robot.components",
    "btcore_robot.process.process": "btcore_robot.components.component",
    "btcore_sim.scene": "btcore_sim.world_description",
}
"""The new names of modules that have moved, by their old names. CHANGELOG.md lists them under "To do"."""
