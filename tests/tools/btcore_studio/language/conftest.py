"""Fixtures of the tests of the language server: a project with open documents, and its nodes."""

from collections.abc import Callable
from pathlib import Path

import pytest

from btcore import Registry
from btcore_studio.language.node_models import models_of
from btcore_studio.language.project import Project, SourceDocument

ROOT = Path(__file__).parents[4]
CURSOR = "¦"


@pytest.fixture(scope="session")
def robot_project() -> Project:
    """A project with the nodes of btcore_robot, as the server knows them, and an enum."""
    nodes = Registry.standard()
    nodes.add_installed_libraries()
    project = Project()
    project.set_models(models_of(nodes), {"RED": 1, "GREEN": 2})
    assert nodes.manifests.keys() == project.registry.manifests.keys(), "every node has a mock node"
    return project


@pytest.fixture
def project(robot_project: Project) -> Project:
    """A project without files, with the nodes of *robot_project*."""
    project = Project()
    project.registry, project.models = robot_project.registry, robot_project.models
    return project


OpenAtCursor = Callable[[str], tuple[SourceDocument, int]]


@pytest.fixture
def open_at_cursor(project: Project) -> OpenAtCursor:
    """Open an unsaved text that contains the cursor as "¦". Returns the document and the offset."""

    def open_document(marked: str) -> tuple[SourceDocument, int]:
        document = project.open("untitled:tree.xml", marked.replace(CURSOR, ""), 1)
        return document, marked.index(CURSOR)

    return open_document
