"""The engine: node and leaf classes, conditions, callbacks and observers."""
