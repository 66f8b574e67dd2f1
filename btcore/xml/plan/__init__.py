"""Check the trees of documents, and plan every node before it is created: manifest, ports and scripts."""
