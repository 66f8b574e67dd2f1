"""What the benchmarks share: pairs of measurements, rows with ratios and targets, and trees."""
