"""Draw trees as SVG, and write running trees as XML."""
