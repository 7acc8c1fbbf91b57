"""Independent truths and the methods a user would take instead: shared by tests and benchmarks, no part of wallid."""
