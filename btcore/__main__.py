"""Run the command ``btcore``, for ``python -m btcore``."""

from btcore.cli.main import main

main(prog_name="btcore")
