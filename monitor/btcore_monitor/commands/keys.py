"""`btcore keys`: create a key pair for encrypted and authenticated connections."""

from pathlib import Path

import click

from btcore_monitor.console import print_line
from btcore_monitor.environment_checks import check_installed


@click.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
def keys(file: Path) -> None:
    """Create a secret key in FILE and its public key in FILE.pub, and print the public key.

    Create a key pair on the robot, and one on each client's machine. FILE stays there; copy FILE.pub to the
    other side. Start the robot with `btcore run … --key-file FILE --allow-key CLIENT.pub`, and a client with
    `btcore monitor … --key-file FILE --robot-key ROBOT.pub`. Existing files are not overwritten.
    """
    check_installed("zmq")
    from btcore_monitor.keys import create_keys, public_file

    print_line(create_keys(file))
    print_line(f"keys: {file} is the secret key; give {public_file(file)} to the other side", err=True)
