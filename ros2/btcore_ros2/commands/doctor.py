"""`btcore ros2 doctor`: what works and what does not in ROS 2, and what to do about it."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Final

import click
from rich.console import Console
from rich.text import Text

from btcore.escaping import escape_controls
from btcore.field_options import FiniteRange
from btcore.program_runner import print_json
from btcore_ros2.diagnosis import Finding, examine_machine
from btcore_ros2.errors import RosError

_SIGNS: Final = {"ok": ("✓", "green"), "warning": ("!", "bold yellow"), "error": ("✗", "bold red")}


@click.command(short_help="Examine ROS 2, its settings and its network.")
@click.option(
    "--seconds",
    type=FiniteRange(0),
    default=3.0,
    show_default=True,
    metavar="S",
    help="How long to search for other ROS nodes.",
)
@click.option(
    "--ros-args", metavar="ARGS", help="Arguments of the ROS node, as one text: '-r __ns:=/robot1'."
)
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
def doctor(seconds: float, ros_args: str | None, as_json: bool) -> None:
    """Examine the installation of ROS 2, its settings, and the ROS nodes that are visible.

    Reports which ROS 2 is used, the domain, the discovery range, the middleware, missing message packages,
    the topics with their types and incompatible QoS, and the source of the time. Each problem is printed with
    a remedy. The exit code is 1 if something prevents the use of ROS 2.
    """
    console = Console(highlight=False, soft_wrap=True)
    findings = []
    for finding in _findings(seconds, ros_args):
        findings.append(finding)
        if not as_json:
            console.print(_line(finding))
    if as_json:
        print_json({"findings": [asdict(finding) for finding in findings]}, indent=2)
    if any(finding.level == "error" for finding in findings):
        raise click.exceptions.Exit(1)


def _line(finding: Finding) -> Text:
    """Return the text for *finding*, with the remedy on a second line."""
    sign, style = _SIGNS[finding.level]
    line = Text.assemble((f"{sign} ", style), (escape_controls(finding.subject), "bold"), ": ")
    line.append(escape_controls(finding.text))
    if finding.remedy:
        line.append(f"\n    → {escape_controls(finding.remedy)}", style="cyan")
    return line


def _findings(seconds: float, ros_args: str | None) -> Iterator[Finding]:
    """Yield the findings about this machine and, if ROS 2 can be used, about the network."""
    usable = True
    for finding in examine_machine():
        usable = usable and finding.level != "error"
        yield finding
    if usable:
        from btcore_ros2.network_diagnosis import examine_network

        try:
            yield from examine_network(seconds, ros_args)
        except RosError as error:
            yield Finding("error", "ROS 2", str(error), "see the message")
