"""The book's systems as commands: `btcore book vff` and others, each with an optional picture."""
