"""The engine: node and leaf classes, conditions, instrumentation and observers."""
