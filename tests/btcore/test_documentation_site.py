"""The addresses of pages in the documentation."""

import subprocess
import sys

from btcore import documentation_site


def test_there_is_no_address_where_btcore_is_not_installed() -> None:
    file = documentation_site.__file__
    program = f"import runpy; print(runpy.run_path({file!r})['documentation_url']('index.html'))"
    command = [sys.executable, "-I", "-S", "-c", program]  # without the installed packages
    assert subprocess.check_output(command, text=True) == "None\n"


def test_an_address_begins_with_the_first_page_of_the_installed_package() -> None:
    url = documentation_site.documentation_url("reference/errors.html")
    assert url is not None
    assert url.startswith("https://")
    assert url.endswith("/reference/errors.html")
