"""Benchmarks as objects: sources, evaluation, and results in the runner's files."""
