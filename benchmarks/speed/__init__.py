"""How fast wallid is, beside what a user would take instead: `python -m benchmarks.speed`."""
