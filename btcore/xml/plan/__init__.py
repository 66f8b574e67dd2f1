"""The trees that documents define, checked, with the ports of every node sorted out."""
