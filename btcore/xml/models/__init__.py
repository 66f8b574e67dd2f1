"""TreeNodesModel: node models written for Groot, read from it, and nodes that stand in for missing code."""
