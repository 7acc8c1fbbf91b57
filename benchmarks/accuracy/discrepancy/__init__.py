"""Records in which an effect is hidden, and how often `wallid.diagnose` finds it."""
