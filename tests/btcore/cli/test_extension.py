"""The extensions of `btcore run`: required members, and the order in which they provide resources."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import pytest
from click.testing import Result

from btcore.cli.extension import gather_resources
from btcore.cli.run_report import print_reports
from btcore.run_extension import RunExtension

for needed in ("zmq", "cv2", "pybullet"):
    pytest.importorskip(needed)
from btcore_monitor.run_extension import MonitorExtension  # noqa: E402
from btcore_navigation.run_extension import NavigationExtension  # noqa: E402
from btcore_sim.run_extension import SimExtension  # noqa: E402

Cli = Callable[..., Result]
TreeFile = Callable[..., Path]


class Body:
    def __init__(self, maker: str) -> None:
        self.maker = maker


class Provider(RunExtension):
    """Provides a body if no other extension does."""

    def __init__(self, name: str) -> None:
        self.name = name

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object] = ()
    ) -> Sequence[object]:
        return [] if any(isinstance(one, Body) for one in provided) else [Body(self.name)]


class FallbackProvider(Provider):
    is_fallback = True


class DependentProvider(Provider):
    def requires(self, wanted: Sequence[type]) -> Sequence[type]:
        return (Body,)


def test_fallback_extensions_provide_after_the_others() -> None:
    simulated, real = FallbackProvider("sim"), Provider("zebra")
    found = gather_resources([simulated, real], {}, [Body])
    assert [one.maker for one in found.resources if isinstance(one, Body)] == ["zebra"]
    assert found.extensions == [real, simulated]
    assert found.without_resources == [simulated]


def test_dependent_extensions_provide_last() -> None:
    builds, simulated = DependentProvider("navigation"), FallbackProvider("sim")
    found = gather_resources([builds, simulated], {}, [Body])
    assert [one.maker for one in found.resources if isinstance(one, Body)] == ["sim"]


class ExclusiveProvider(Provider):
    """Provides the body alone, with the option `real`."""

    def takes_over(self, settings: Mapping[str, Any], wanted: Sequence[type]) -> Sequence[type]:
        return (Body,) if settings.get("real") else ()

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object] = ()
    ) -> Sequence[object]:
        return [Body(self.name)] if Body in wanted and settings.get("real") else []


class Observer(Provider):
    """Records the types that it is asked for."""

    def requires(self, wanted: Sequence[type]) -> Sequence[type]:
        self.asked = tuple(wanted)
        return (str,) if Body in wanted else ()

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object] = ()
    ) -> Sequence[object]:
        self.asked += tuple(wanted)
        return ()


@pytest.mark.parametrize("real", [True, False])
def test_a_type_that_is_taken_over_is_wanted_from_no_other_extension(real: bool) -> None:
    exclusive, observer = ExclusiveProvider("real"), Observer("other")
    found = gather_resources([observer, exclusive], {"real": real}, [Body])
    assert [one.maker for one in found.resources if isinstance(one, Body)] == ["real"] * real
    assert (Body in observer.asked) is not real


@pytest.mark.parametrize("step", [1, -1])
def test_an_extension_sees_the_requirements_of_the_others_in_any_order(step: int) -> None:
    observer = Observer("other")
    gather_resources([DependentProvider("builder"), observer][::step], {}, [])
    assert str in observer.asked  # which the observer requires if Body is wanted


def test_extensions_of_the_project_follow_the_protocol() -> None:
    extensions: list[RunExtension] = [MonitorExtension(), NavigationExtension(), SimExtension()]
    assert [one.is_fallback for one in extensions] == [False, False, True]


@pytest.fixture
def offer(monkeypatch: pytest.MonkeyPatch) -> Callable[[object], None]:
    """Install a class as the only extension: 'rover' of the distribution 'rover-driver'."""

    def install(extension: object) -> None:
        installed = metadata.entry_points
        rover = SimpleNamespace(
            name="rover", dist=SimpleNamespace(name="rover-driver"), load=lambda: extension
        )
        monkeypatch.setattr(
            metadata,
            "entry_points",
            lambda group: [rover] if group == "btcore.run_extensions" else installed(group=group),
        )

    return install


class WithoutAttach:
    """An extension that imports nothing from btcore and lacks the method `attach`."""

    options: Sequence[click.Option] = ()
    single_run_options = ()
    sweep_options: Mapping[str, click.Option] = {}
    used_by = None
    is_fallback = False

    def requires(self, wanted: Any) -> Any:
        return ()

    def takes_over(self, settings: Any, wanted: Any) -> Any:
        return ()

    def provide(self, settings: Any, wanted: Any, provided: Any) -> Any:
        return ()

    def replace_tree(self, tree: Any, resources: Any, settings: Any) -> None: ...

    def on_interrupt(self) -> None: ...

    def report(self) -> Any:
        return {"rover": {"trips": 1}}


class Complete(WithoutAttach):
    def attach(self, tree: Any, resources: Any, settings: Any) -> Any:
        return nullcontext()


def test_extension_with_every_hook_joins_the_run(cli: Cli, tree_file: TreeFile, offer: Any) -> None:
    offer(Complete)
    done = cli("run", tree_file("<AlwaysSuccess/>"))
    assert done.exit_code == 0, done.stderr
    assert "trips" in done.stderr


class Misspelled(RunExtension):
    def replce_tree(self, tree: Any, resources: Any, settings: Any) -> None: ...


class Renamed(WithoutAttach):
    def atach(self, tree: Any, resources: Any, settings: Any) -> Any:
        return nullcontext()


class Shortened(RunExtension):
    def provide(self, settings: Any, wanted: Any) -> Any:  # type: ignore[override]
        return ()


class Lacking:
    options = ()


class WithTexts(RunExtension):
    options = ("--world",)  # type: ignore[assignment]


class NeedsAnArgument(RunExtension):
    def __init__(self, robot: object) -> None:
        self.robot = robot


@pytest.mark.parametrize(
    ("extension", "said"),
    [
        (Misspelled, "unknown member 'replce_tree' (did you mean 'replace_tree'?)"),
        (WithoutAttach, "missing member 'attach'. The members are described in"),
        (Renamed, "unknown member 'atach' (did you mean 'attach'?)"),
        (Shortened, "member 'provide' must be a method that takes (settings, wanted, provided)"),
        (Lacking, "missing member 'attach'; missing member 'is_fallback'; missing member 'on_interrupt'"),
        (WithTexts, "member 'options' must be a sequence of click.Option"),
        (NeedsAnArgument, "creating it raised TypeError: "),
    ],
    ids=lambda value: value.__name__ if isinstance(value, type) else "",
)
@pytest.mark.parametrize("command", ["run", "sweep"])
def test_an_extension_that_breaks_the_protocol_is_named(
    cli: Cli, tree_file: TreeFile, offer: Any, extension: object, said: str, command: str
) -> None:
    offer(extension)
    done = cli(command, tree_file("<AlwaysSuccess/>"))
    assert done.exit_code == 2
    assert "the extension 'rover' of the distribution 'rover-driver' cannot be used: " in done.stderr
    assert said in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


def test_the_summary_shortens_long_lists(capsys: pytest.CaptureFixture[str]) -> None:
    print_reports({"robot": {"places": ["a"] * 8, "visited": ["start"] * 30, "none": ()}})
    visited = f"visited {'start, ' * 8}… (30 in all)"
    assert capsys.readouterr().err.split("  ")[1:] == [f"places {'a, ' * 7}a", visited, "none none\n"]
