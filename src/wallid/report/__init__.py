"""The files of a run: report.html, its figures and captions, and result.json; all are written, or none."""

from .writer import result_as_json, write_report

__all__ = ["result_as_json", "write_report"]
