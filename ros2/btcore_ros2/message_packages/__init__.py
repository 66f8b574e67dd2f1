"""Message packages that are not on PyPI: their definitions, and the wheels that are built from them."""
