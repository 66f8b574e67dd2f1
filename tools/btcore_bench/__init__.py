"""`btcore bench`: run the project's benchmarks. No name of this package is public."""
