"""Files that are no CSV, recognised by their first bytes, and what to do with each."""

from __future__ import annotations

_SPREADSHEET = (
    "open it in a spreadsheet program and save the sheet of the readings as CSV, or read it with `pandas.read_excel` "
    "and give the DataFrame to `wallid.Case.from_dataframe`"
)
_UNPACK = "unpack it, and give the CSV file that is in it"
_EXPORT = "export the readings from the logger's program as CSV"
_FRAME = "read it with pandas, and give the DataFrame to `wallid.Case.from_dataframe`"

_SIGNATURES: tuple[tuple[bytes, str, str], ...] = (
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an Excel workbook (.xls, or an encrypted .xlsx)", _SPREADSHEET),
    (b"PK\x03\x04", "a zip archive", _UNPACK),
    (b"PK\x05\x06", "an empty zip archive", _UNPACK),
    (b"\x1f\x8b", "a gzip file (.gz)", _UNPACK),
    *((b"BZh%d1AY&SY" % level, "a bzip2 file (.bz2)", _UNPACK) for level in range(1, 10)),
    (b"\xfd7zXZ\x00", "an xz file (.xz)", _UNPACK),
    (b"\x28\xb5\x2f\xfd", "a Zstandard file (.zst)", _UNPACK),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive (.7z)", _UNPACK),
    (b"Rar!\x1a\x07", "a RAR archive (.rar)", _UNPACK),
    (b"%PDF-", "a PDF document", _EXPORT),
    (b"{\\rtf", "a text document (.rtf)", _EXPORT),
    (b"\x89PNG\r\n\x1a\n", "a picture (PNG)", _EXPORT),
    (b"\xff\xd8\xff", "a picture (JPEG)", _EXPORT),
    (b"GIF87a", "a picture (GIF)", _EXPORT),
    (b"GIF89a", "a picture (GIF)", _EXPORT),
    (b"II*\x00", "a picture (TIFF)", _EXPORT),
    (b"MM\x00*", "a picture (TIFF)", _EXPORT),
    (b"SQLite format 3\x00", "an SQLite database", _FRAME),
    (b"\x89HDF\r\n\x1a\n", "an HDF5 file", _FRAME),
)
_IN_ZIP = (  # a name inside the archive
    (b"xl/", "an Excel workbook (.xlsx)", _SPREADSHEET),
    (b"application/vnd.oasis.opendocument.spreadsheet", "a spreadsheet (.ods)", _SPREADSHEET),
    (b"word/", "a Word document (.docx)", _EXPORT),
    (b"Index/Document.iwa", "a Numbers spreadsheet", _SPREADSHEET),
)
_MARKUP = (b"<!doctype html", b"<html")


def foreign_format(raw: bytes) -> tuple[str, str] | None:
    """What a file is that is no CSV, and what to do with it; None for a file that may be a CSV.

    Args:
        raw: the content of the file.
    """
    for signature, kind, remedy in _SIGNATURES:
        if raw.startswith(signature):
            if signature.startswith(b"PK"):
                for name, packed_kind, packed_remedy in _IN_ZIP:
                    if name in raw:
                        return packed_kind, packed_remedy
            return kind, remedy
    if raw.startswith(b"PAR1") and raw.endswith(b"PAR1"):  # at the start alone it may be the name of a column
        return "a Parquet file", _FRAME
    if raw[:200].lstrip(b"\xef\xbb\xbf \t\r\n").lower().startswith(_MARKUP):
        return "a web page (HTML)", "download the file itself, or " + _EXPORT
    return None
