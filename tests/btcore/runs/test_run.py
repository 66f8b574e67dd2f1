"""`Run`: objects for leaves, warnings, incomplete outputs, and pauses."""

import re
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Protocol, runtime_checkable

import pytest
from click.testing import CliRunner

import btcore
from btcore import OutputError, ProviderError, Registry, Report, Run, RunSettings, Settings, option, provider
from btcore.cli.main import main
from btcore.field_options import create_options
from btcore.logs import read_log
from btcore.runs.core_providers import LogSettings
from btcore.runs.run import TreelessProgram
from btcore.signals import delayed_signals

FAST = RunSettings(fast=True)


def program(ticks: int = 1) -> TreelessProgram:
    """Return a program that ends after some ticks."""
    rest = iter(range(ticks - 1))
    return TreelessProgram("Test", lambda: next(rest, None) is not None)


def write_tree(folder: Path, leaf: str) -> Path:
    file = folder / "tree.xml"
    file.write_text(
        f'<root BTCPP_format="4"><BehaviorTree ID="Main">{leaf}</BehaviorTree></root>', encoding="utf-8"
    )
    return file


@runtime_checkable
class Lamp(Protocol):
    def shine(self) -> str: ...


class Torch:
    def shine(self) -> str:
        return "torch"


class Beacon:
    def shine(self) -> str:
        return "beacon"


@provider
def torch() -> Torch:  # fits a Lamp, too, and is opened first
    return Torch()


@provider(provides=(Lamp,))
def beacon(torch: Torch) -> Beacon:
    return Beacon()


def test_a_leaf_gets_the_object_that_was_chosen_for_its_type(tmp_path: Path) -> None:
    seen = []

    @btcore.action
    def look(lamp: Lamp, torch: Torch) -> bool:
        seen.append((lamp.shine(), torch.shine()))
        return True

    nodes = Registry.standard()
    nodes.add(look)
    with Run(write_tree(tmp_path, "<Look/>"), nodes=nodes, providers=[torch, beacon]) as run:
        assert [type(one) for one in run.resources] == [Torch, Beacon]
        assert run.tick_to_end() is btcore.SUCCESS
    assert seen == [("beacon", "torch")]


def test_trees_that_a_program_creates_get_the_chosen_objects_too() -> None:
    seen = []

    @btcore.action
    def look(lamp: Lamp) -> bool:
        seen.append(lamp.shine())
        return True

    nodes = Registry.standard()
    nodes.add(look)
    xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Look/></BehaviorTree></root>'
    with Run(program(), providers=[torch, beacon]).want(Lamp, optional=True) as run:
        btcore.loads(xml, nodes=nodes, resources=run.resources).tick_once()
    assert seen == ["beacon"]


def test_an_object_that_two_providers_provide_is_listed_once() -> None:
    @provider(provides=(Lamp,))
    def lamp(torch: Torch) -> object:
        return torch

    with Run(program(), providers=[torch, lamp]).want(Lamp) as run:
        assert run.resources == [run.find(Torch)]
        with pytest.raises(RuntimeError, match="before 'with'"):
            run.want(Torch)


class LampSettings(Settings):
    watts: Annotated[float, option("The power.", gt=0)] = 5.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (LampSettings(watts=-1.0), "LampSettings: Expected `float` > 0.0 - at `$.watts`"),
        (LampSettings(watts="bright"), "LampSettings: Expected `float`, got `str` - at `$.watts`"),  # type: ignore[arg-type]
        (LampSettings, "is not a settings object: write"),
    ],
)
def test_the_values_of_a_program_are_checked_like_options(settings: Any, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=re.escape(message)):
        Run(program(), settings=[settings])


def test_a_field_that_is_no_option_is_named() -> None:
    class Wrong(Settings):
        watts: int = 3

    with pytest.raises(btcore.BtcoreError, match="the field 'watts' of Wrong: the type <class 'int'> is no"):
        create_options(Wrong)


def test_the_exception_of_a_leaf_is_raised_and_kept(tmp_path: Path) -> None:
    @btcore.action
    def explode() -> bool:
        raise OSError("no power")

    nodes = Registry.standard()
    nodes.add(explode)
    with Run(write_tree(tmp_path, "<Explode/>"), nodes=nodes) as run:
        with pytest.raises(btcore.NodeExecutionError, match="no power") as caught:
            run.tick_to_end()
        assert run.error is caught.value
    assert run.exit_code == 3


def test_settings_without_effect_give_a_warning_with_the_reason() -> None:
    @provider
    def torch(settings: LampSettings) -> Torch:
        return Torch()

    with (
        pytest.warns(UserWarning, match="LampSettings have no effect: no leaf needs a Torch"),
        Run(program(), providers=[torch], settings=[LampSettings()]),
    ):
        pass


@provider
def disk(settings: LampSettings, tree: btcore.Tree) -> Iterator[object]:
    try:
        yield None
    finally:
        raise OutputError("the recording is incomplete")


def test_all_incomplete_outputs_are_named() -> None:
    @provider
    def other(disk_of_run: Torch, settings: LampSettings, tree: btcore.Tree) -> Iterator[object]:
        yield None
        raise OutputError("the picture is missing")

    run = Run(program(), providers=[disk, other], resources=[Torch()], settings=[LampSettings()])
    with pytest.raises(OutputError, match="recording is incomplete; the picture is missing"), run:
        run.tick_to_end()
    assert [str(error) for error in run.providers.errors] == [
        "the recording is incomplete",
        "the picture is missing",
    ]
    assert run.exit_code == 4


def test_an_incomplete_output_does_not_hide_the_exception_of_the_run() -> None:
    run = Run(program(), providers=[disk], settings=[LampSettings()])
    with pytest.raises(ValueError, match="of the program"), run:
        raise ValueError("of the program")
    assert [str(error) for error in run.providers.errors] == ["the recording is incomplete"]


def test_a_program_logs_its_tree(tmp_path: Path) -> None:
    log = str(tmp_path / "run.btlog")
    tree = write_tree(tmp_path, '<Sleep msec="200"/>')
    with Run(tree, settings=[FAST, LogSettings((log,))]) as run:
        run.tick_to_end()
    assert [change.status.name for change in read_log(log).transitions][:2] == ["RUNNING", "SUCCESS"]


def test_a_pause_stops_ticks_and_simulated_time() -> None:
    ticks: list[float] = []
    at_the_end_of_the_pause = []

    def end_pause() -> None:
        at_the_end_of_the_pause.append(len(ticks))
        run.resume()

    def on_tick(status: btcore.Status) -> None:
        ticks.append(run.clock.now() / 1e9)
        if len(ticks) == 3:
            run.pause()
            threading.Timer(0.05, end_pause).start()

    with Run(program(ticks=5), settings=[FAST]) as run:
        run.tick_to_end(on_tick=on_tick)
    assert ticks == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert at_the_end_of_the_pause == [3]
    assert run.missed_ticks == 0


def test_ticks_keep_their_rate_after_a_slow_tick() -> None:
    times: list[float] = []

    def on_tick(status: btcore.Status) -> None:
        times.append(run.clock.now() / 1e9)
        if len(times) == 2:
            assert isinstance(run.clock, btcore.SimClock)
            run.clock.advance(0.25)

    with Run(program(ticks=4), settings=[FAST]) as run:
        run.tick_to_end(on_tick=on_tick)
    assert times == pytest.approx([0.0, 0.1, 0.4, 0.5])
    assert run.missed_ticks == 2


def test_a_tree_that_was_reloaded_is_ticked_at_once() -> None:
    times: list[float] = []
    attempts = iter([False, True])  # at the beginning of the wait after the first tick, and 50 ms later

    class Reloader:
        is_endless = True

        def reload(self) -> bool:
            if not next(attempts, False):
                return False
            run.tree.halt()
            run.replace_tree(program(ticks=2).create_tree(run.clock))
            return True

        def on_end(self, error: btcore.NodeExecutionError | None) -> None:
            assert error is None

    with Run(program(ticks=9), settings=[RunSettings(fast=True, duration=9.0)]) as run:
        run.tick_to_end(on_tick=lambda _: times.append(run.clock.now() / 1e9), reloader=Reloader())
    assert run.status is btcore.SUCCESS
    assert times == pytest.approx([0.0, 0.05, 0.15])


def test_a_clock_may_end_a_wait() -> None:
    class Impatient(btcore.SimClock):
        def wait_until(self, deadline: int, wake: threading.Event) -> bool:
            return True

    with Run(program(ticks=3), clock=Impatient(), settings=[FAST]) as run:
        assert run.tick_to_end() is btcore.SUCCESS
    assert (run.tree.ticks, run.elapsed_s) == (3, 0.0)


def test_a_tree_that_is_only_stepped_is_halted_at_the_end(tmp_path: Path) -> None:
    with Run(write_tree(tmp_path, '<Sleep msec="200"/>'), settings=[FAST]) as run:
        assert run.step() is btcore.RUNNING
        assert run.end_reason is None
    assert run.tree.status is btcore.IDLE
    assert run.end_reason == "done"


def test_a_run_is_ticked_between_its_entry_and_its_exit() -> None:
    for use in (Run.tick_to_end, Run.step):
        run = Run(program())
        with pytest.raises(RuntimeError, match="write 'with Run"):
            use(run)
        with run:
            pass
        with pytest.raises(RuntimeError, match="the run has ended, and its providers are closed"):
            use(run)


class Notebook:
    """The object of a provider whose end depends on that of the run."""


@provider
def notebook(report: Report) -> Iterator[Notebook]:
    yield Notebook()
    report["end"] = report.end_reason


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_the_first_signal_ends_the_ticks_as_usual(number: signal.Signals, code: int) -> None:
    with Run(program(ticks=1000), providers=[notebook], settings=[FAST]).want(Notebook) as run:
        run.tick_to_end(on_tick=lambda status: signal.raise_signal(number))
    assert (run.end_reason, run.tree.ticks, run.exit_code) == ("interrupted", 1, code)
    assert run.report == {"end": "interrupted"}


@pytest.mark.parametrize(
    ("number", "raised"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)]
)
def test_a_second_signal_interrupts_the_tick_and_halts_the_tree(
    tmp_path: Path, number: signal.Signals, raised: type[BaseException]
) -> None:
    @btcore.action
    def hang() -> bool:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(number)
        return True

    nodes = Registry.standard()
    nodes.add(hang)
    tree = write_tree(tmp_path, '<Parallel><Sleep msec="500"/><Hang/></Parallel>')
    with pytest.raises(raised), Run(tree, nodes=nodes, settings=[FAST]) as run:
        run.tick_to_end()
    assert {node.status for node in run.tree.nodes} == {btcore.IDLE}
    assert (run.error, run.end_reason) == (None, "interrupted")


def test_errors_of_the_file_come_before_the_providers(tmp_path: Path) -> None:
    with pytest.raises(btcore.TreeError, match="E101"):
        Run(write_tree(tmp_path, "<Absent/>"))


def test_an_error_while_providers_open_names_those_that_failed_to_close() -> None:
    @provider
    def arm(lamp: Lamp) -> Iterator[Torch]:
        raise ValueError("no power")
        yield Torch()

    @provider(provides=(Lamp,))
    def lamp() -> Iterator[Beacon]:
        try:
            yield Beacon()
        finally:
            raise OutputError("the recording is incomplete")

    with pytest.raises(ProviderError, match="no power") as caught:
        Run(program(), providers=[arm, lamp]).want(Torch).__enter__()
    assert caught.value.__notes__ == ["the recording is incomplete"]


@pytest.mark.parametrize(
    ("number", "raised"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)]
)
def test_a_signal_while_providers_open_closes_those_that_are_open(
    number: signal.Signals, raised: type[BaseException]
) -> None:
    @provider
    def slow(notebook: Notebook) -> Torch:
        with delayed_signals():
            signal.raise_signal(number)
            opened.append("process")
        opened.append("robot")
        return Torch()

    opened: list[str] = []
    before = signal.getsignal(number)
    run = Run(program(), providers=[notebook, slow]).want(Torch)
    with pytest.raises(raised):
        run.__enter__()
    assert opened == ["process"]
    assert run.report == {}
    assert signal.getsignal(number) is before


def test_a_signal_while_providers_are_closed_ends_a_wait_and_all_are_closed() -> None:
    @provider(provides=(Lamp,))
    def viewer(report: Report, notebook: Notebook) -> Iterator[Beacon]:
        yield Beacon()
        signal.raise_signal(signal.SIGINT)
        report["waited"] = True

    with Run(program(), providers=[viewer, notebook]).want(Lamp) as run:
        assert run.tick_to_end() is btcore.SUCCESS
    assert (run.end_reason, run.exit_code, run.report) == ("interrupted", 130, {})


def test_an_error_after_the_yield_closes_the_others_and_is_raised_at_the_end() -> None:
    @provider(provides=(Lamp,))
    def arm(torch: Torch) -> Iterator[Beacon]:
        yield Beacon()
        raise ValueError("no power")

    closed = []

    @provider
    def torch() -> Iterator[Torch]:
        yield Torch()
        closed.append("torch")

    run = Run(program(), providers=[torch, arm]).want(Lamp)
    with pytest.raises(ProviderError, match=r"the provider arm .* raised ValueError at .*: no power"), run:
        run.tick_to_end()
    assert closed == ["torch"]
    assert (run.end_reason, run.exit_code) == ("done", 2)


def test_a_leaf_that_raises_at_the_end_does_not_hide_an_incomplete_output(tmp_path: Path) -> None:
    class Watch(btcore.StatefulAction):
        def on_start(self) -> btcore.Status:
            return btcore.RUNNING

        def on_running(self) -> btcore.Status:
            return btcore.RUNNING

        def on_halted(self) -> None:
            raise ValueError("stuck")

    @provider
    def recorder() -> Iterator[Torch]:
        try:
            yield Torch()
        finally:
            raise OutputError("the recording is incomplete")

    nodes = Registry.standard()
    nodes.add(Watch)
    run = Run(write_tree(tmp_path, "<Watch/>"), nodes=nodes, providers=[recorder]).want(Torch)
    with pytest.raises(btcore.NodeExecutionError, match="stuck"), run:
        run.step()
    assert list(map(str, run.providers.errors)) == ["the recording is incomplete"]
    assert (run.end_reason, run.exit_code) == ("raised", 3)


@pytest.mark.parametrize("count", [0, 2])
def test_a_provider_yields_once(count: int) -> None:
    @provider
    def torch() -> Iterator[Torch]:
        yield from [Torch()] * count

    with (
        pytest.raises(ProviderError, match=r"the provider torch .* does not yield exactly once"),
        Run(program(), providers=[torch]).want(Torch),
    ):
        pass


def test_results_that_are_no_json_data_are_an_error_at_their_line() -> None:
    @provider
    def torch(report: Report) -> Torch:
        report.add("torch", {"lamp": object()})
        return Torch()

    with (
        pytest.raises(
            ProviderError, match=r"raised TypeError at .*test_run.py:\d+: .* not JSON serializable"
        ),
        Run(program(), providers=[torch]).want(Torch),
    ):
        pass


@provider
def none() -> tuple[Torch, Beacon] | None:
    return None


def test_a_provider_of_several_objects_may_provide_none(tmp_path: Path) -> None:
    with Run(program(), providers=[none]).want(Beacon, optional=True) as run:
        assert run.find(Beacon) is None

    @btcore.action
    def look(beacon: Beacon) -> bool:
        return True

    nodes = Registry.standard()
    nodes.add(look)
    with pytest.raises(btcore.TreeError, match="the run does not provide it") as caught:
        Run(write_tree(tmp_path, "<Look/>"), nodes=nodes, providers=[none]).__enter__()
    assert caught.value.__notes__ == [f"the provider {none} has provided None"]


def test_the_duration_also_ends_a_pause() -> None:
    with Run(program(ticks=9), settings=[RunSettings(duration=0.1)]) as run:
        run.pause()
        run.tick_to_end()
    assert (run.end_reason, run.tree.ticks) == ("duration", 0)


def test_a_signal_ends_a_pause() -> None:
    with Run(program(ticks=9), settings=[FAST]) as run:
        run.pause()
        timer = threading.Timer(0.05, signal.raise_signal, [signal.SIGINT])
        timer.start()
        run.tick_to_end()
    assert (run.end_reason, run.tree.ticks) == ("interrupted", 0)


def test_a_run_that_a_signal_has_interrupted_can_continue() -> None:
    times: list[int] = []
    with Run(program(ticks=5), settings=[FAST]) as run:
        run.tick_to_end(on_tick=lambda status: signal.raise_signal(signal.SIGINT))
        assert run.tree.context.wake_event.wait(10.0)  # a thread sets it
        run.tick_to_end(on_tick=lambda status: times.append(run.clock.now()))
    assert (run.end_reason, run.exit_code) == ("done", 0)
    assert len(set(times)) == len(times) == 4


def test_a_run_that_continues_repeats_nodes_within_a_tick_again(tmp_path: Path) -> None:
    repeating = '<Sequence><Sleep msec="50"/><Repeat num_cycles="9"><AlwaysSuccess/></Repeat></Sequence>'
    results: list[btcore.Status] = []
    with Run(write_tree(tmp_path, repeating), settings=[FAST]) as run:
        run.tick_to_end(on_tick=lambda status: signal.raise_signal(signal.SIGINT))
        run.tick_to_end(on_tick=results.append)
    assert results == [btcore.RUNNING, btcore.SUCCESS]


def test_a_leaf_cannot_get_what_follows_the_tree() -> None:
    @provider
    def torch(tree: btcore.Tree) -> Torch:
        return Torch()

    with pytest.raises(
        ProviderError, match="has the parameter Tree, so that leaves cannot get its object, and no settings"
    ):
        Run(program(), providers=[torch]).__enter__()


def test_a_file_with_providers_alone_is_a_plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    leaves = tmp_path / "lamp_leaves.py"
    leaves.write_text(
        "import btcore\nclass Lamp: ...\n@btcore.action\ndef Look(lamp: Lamp) -> bool:\n    return True\n"
    )
    devices = tmp_path / "lamp_devices.py"
    devices.write_text(
        "import btcore\nfrom lamp_leaves import Lamp\n@btcore.provider\ndef lamp() -> Lamp:\n"
        "    return Lamp()\n"
    )
    tree = str(write_tree(tmp_path, "<Look/>"))
    command = ["run", tree, "--plugin", "lamp_leaves", "--plugin", str(devices)]
    result = CliRunner().invoke(main, command)
    assert result.exit_code == 0, result.output
