"""The monitor's window, drawn by rerun: nothing outside this package imports rerun."""
