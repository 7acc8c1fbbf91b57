"""Benchmarks of speed, accuracy and stress, and the independent references that they share with the tests."""
