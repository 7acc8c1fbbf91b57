"""Units of time in SI."""

DAY = 86400.0
"""s"""
