"""A logger's file, read step by step onto one uniform time grid; each step notes what it did."""

from .cleaning_log import Cleaning
from .file_format import Format
from .uniform_record import Record, read_record

__all__ = ["Cleaning", "Format", "Record", "read_record"]
