"""Which effects are missing: the score test of all candidates, their fits, and the stepwise selection among them."""
