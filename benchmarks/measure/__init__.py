"""The parts that benchmarks share: paired measurements, reports with targets, and trees."""
