"""`python -m btcore_monitor` is `btcore monitor`."""

import click

from btcore_monitor.commands.monitor import monitor

if __name__ == "__main__":
    # As `btcore monitor` exits; click's own default, 1, is a tree's FAILURE there.
    click.ClickException.exit_code = 2
    monitor(prog_name="btcore monitor")
