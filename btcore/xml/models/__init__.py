"""Node models: read and write a TreeNodesModel (the palette of Groot), and replace nodes without code."""
