"""Likelihood, noise covariance, priors, Gauss-Newton and intervals, for the parameters of one window."""
