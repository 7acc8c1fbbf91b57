"""What a user would take instead of wallid: SciPy, plain diffrax, pyMOR, a particle swarm, and C as the limit."""
