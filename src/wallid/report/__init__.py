"""What a run writes: the page, its figures and captions, result.json; all files or none."""

from .writer import dumps, write

__all__ = ["dumps", "write"]
