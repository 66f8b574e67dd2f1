"""The book's systems as commands: ``btcore book vff`` and its siblings, with a picture each."""
