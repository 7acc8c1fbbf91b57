"""Files that are no CSV, given as one."""

import bz2
import gzip
import lzma
import zipfile

import numpy as np
import pytest
from matplotlib import pyplot
from refusals import refuses

from wallid.records.uniform_record import read_record

COLUMNS = {"time": "time", "left": "T_left", "right": "T_right"}
TEXT = b"time,T_left,T_right\n0,1,2\n600,1,3\n1200,1,4\n"


def workbook(path, inside):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(inside, TEXT)


def picture(path, kind):
    figure = pyplot.figure(figsize=(0.2, 0.2))
    figure.savefig(path, format=kind)
    pyplot.close(figure)


MADE = {
    "an Excel workbook (.xlsx)": lambda path: workbook(path, "xl/workbook.xml"),
    "a Word document (.docx)": lambda path: workbook(path, "word/document.xml"),
    "a zip archive": lambda path: workbook(path, "record.csv"),
    "an Excel workbook (.xls": lambda path: path.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(512)),
    "a gzip file": lambda path: path.write_bytes(gzip.compress(TEXT)),
    "a bzip2 file": lambda path: path.write_bytes(bz2.compress(TEXT)),
    "an xz file": lambda path: path.write_bytes(lzma.compress(TEXT)),
    "a PDF document": lambda path: picture(path, "pdf"),
    "a picture (PNG)": lambda path: picture(path, "png"),
    "a picture (JPEG)": lambda path: picture(path, "jpg"),
    "a picture (TIFF)": lambda path: picture(path, "tiff"),
    "a Parquet file": lambda path: path.write_bytes(b"PAR1\x15\x00PAR1"),
    "a web page (HTML)": lambda path: path.write_bytes(
        b"\xef\xbb\xbf\n<!DOCTYPE html><html><body>log in</body></html>"
    ),
}


@pytest.mark.parametrize("kind", MADE)
def test_what_a_file_is_and_what_to_do(tmp_path, kind):
    path = tmp_path / "record.csv"
    MADE[kind](path)
    message = refuses(lambda: read_record(path, **COLUMNS), f"record.csv: this is {kind}", "CSV")
    assert any(
        word in message for word in ("save the sheet", "unpack it", "export the readings", "read it with pandas")
    )


def test_a_spreadsheet_can_come_through_pandas(tmp_path):
    workbook(tmp_path / "record.xlsx", "xl/workbook.xml")
    parts = "save the sheet of the readings as CSV", "pandas.read_excel", "wallid.Case.from_dataframe"
    refuses(lambda: read_record(tmp_path / "record.xlsx", **COLUMNS), *parts)


@pytest.mark.parametrize("start", [b"", b"\xef\xbb\xbf", b"II,", b"BZh,", b"PK,", b"PAR1,"])
def test_a_csv_is_read(tmp_path, start):
    """Also one whose first letters are those of a signature."""
    header = b"time,T_left,T_right\n" if start in (b"", b"\xef\xbb\xbf") else b"time,T_left,T_right,x\n"
    rows = b"".join(b"%d,%d,2\n" % (600 * k, k % 4) for k in range(12))
    (tmp_path / "record.csv").write_bytes((start + b"line above\n" if b"," in start else start) + header + rows)
    assert np.isclose(read_record(tmp_path / "record.csv", **COLUMNS).step, 600.0)
