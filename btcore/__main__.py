"""``python -m btcore`` is ``btcore``."""

from btcore.cli.main import main

main(prog_name="btcore")
