"""A wall of stones and mortar in a diagnosis of one dimension: what its section changes, and the evidence for it."""
