"""Records in which an effect is hidden, and how often `wallid.explain` finds it."""
