"""``python -m btcore_monitor`` is ``btcore monitor``."""

from btcore_monitor.commands.monitor import monitor

if __name__ == "__main__":
    monitor(prog_name="btcore monitor")
