"""Check the trees of documents and plan them: the definition, ports and scripts of every node."""
