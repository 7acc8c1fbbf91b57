"""Units that the field speaks in, in SI."""

DAY = 86400.0
"""s"""
