"""Reading of a logger's file as a record on a uniform time grid; each step returns data and a log of its changes."""

from .cleaning_log import CleaningLog
from .file_format import FileFormat
from .uniform_record import Record, read_record

__all__ = ["CleaningLog", "FileFormat", "Record", "read_record"]
