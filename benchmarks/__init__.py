"""Benchmarks, and the independent truths that the examples and the tests are judged by."""
