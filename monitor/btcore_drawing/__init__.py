"""Draw trees: their layout, symbols and folding, as SVG, as PNG and in the terminal; list their data flow."""
