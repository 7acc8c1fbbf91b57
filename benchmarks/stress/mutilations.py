"""What loggers, spreadsheets, transfers and people do to a record's file, each as a function of its text.

Every mutilation takes the lines of a CSV file (the header first) and a random generator, and gives lines;
those of `ENCODINGS` take the whole text and give bytes. None of them knows how wallid reads.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from datetime import datetime, timedelta

Lines = list[str]
_WORDS = ["Err", "---", "NaN", "over", "#VALUE!", "abc", "20.5 C", "true", "0x1F", "1e999", "-1e308", "inf", "'", "\t"]
_STAMPS = ["", "noon", "2099-01-01T00:00:00", "1066-01-01", "0", "-5", "2020-02-30T00:00:00", "2020-03-01T00:00:00Z"]


def _rows(lines: Lines, random: random.Random, most: int = 5) -> list[int]:
    """A few lines below the header."""
    return [random.randrange(1, len(lines)) for _ in range(random.randint(1, most))] if len(lines) > 1 else []


def _cells(lines: Lines, random: random.Random, change: Callable[[str], str], most: int = 5) -> Lines:
    """Change a few cells that are no times."""
    for row in _rows(lines, random, most):
        cells = lines[row].split(",")
        if len(cells) > 1:
            column = random.randrange(1, len(cells))
            cells[column] = change(cells[column])
            lines[row] = ",".join(cells)
    return lines


def _times(lines: Lines, change: Callable[[int, datetime], datetime | str]) -> Lines:
    """Change every time that is one."""
    for row in range(1, len(lines)):
        first, mark, rest = lines[row].partition(",")
        try:
            moment = datetime.fromisoformat(first)
        except ValueError:
            continue
        try:
            found = change(row, moment)
        except OverflowError:  # a year past 9999
            continue
        lines[row] = (found if isinstance(found, str) else found.isoformat()) + mark + rest
    return lines


def _column(lines: Lines, random: random.Random, change: Callable[[int, str], str], share: float = 1.0) -> Lines:
    """Change one column that is no time, from some row on."""
    column, first = random.randrange(1, 5), random.randrange(1, max(2, int(share * len(lines)) + 1))
    for row in range(first, len(lines)):
        cells = lines[row].split(",")
        if column < len(cells):
            cells[column] = change(row, cells[column])
            lines[row] = ",".join(cells)
    return lines


def _number(cell: str, change: Callable[[float], float]) -> str:
    try:
        return f"{change(float(cell)):.4g}"
    except ValueError:
        return cell


def words(lines: Lines, random: random.Random) -> Lines:
    return _cells(lines, random, lambda cell: random.choice(_WORDS))


def many_words(lines: Lines, random: random.Random) -> Lines:
    return _cells(lines, random, lambda cell: random.choice(_WORDS), most=200)


def empty_cells(lines: Lines, random: random.Random) -> Lines:
    return _cells(lines, random, lambda cell: "", most=30)


def spikes(lines: Lines, random: random.Random) -> Lines:
    return _cells(lines, random, lambda cell: random.choice(["85.0", "-127", "999.9", "0", "150", "-40"]))


def lost_rows(lines: Lines, random: random.Random) -> Lines:
    for row in sorted(set(_rows(lines, random)), reverse=True):
        del lines[row : row + random.choice([1, 1, 1, 3, 12])]
    return lines


def repeated_rows(lines: Lines, random: random.Random) -> Lines:
    for row in _rows(lines, random):
        lines.insert(min(row + random.choice([0, 0, 7]), len(lines)), lines[row])
    return lines


def swapped_rows(lines: Lines, random: random.Random) -> Lines:
    for row in _rows(lines, random, 3):
        other = min(row + random.randint(1, 4), len(lines) - 1)
        lines[row], lines[other] = lines[other], lines[row]
    return lines


def blocks_in_another_order(lines: Lines, random: random.Random) -> Lines:
    cut = random.randrange(1, len(lines) + 1)
    return [*lines[:1], *lines[cut:], *lines[1:cut]]


def newest_first(lines: Lines, random: random.Random) -> Lines:
    return [*lines[:1], *reversed(lines[1:])]


def jitter(lines: Lines, random: random.Random) -> Lines:
    size = random.choice([1, 20, 400, 2500])
    return _times(lines, lambda row, t: t + timedelta(seconds=random.randint(-size, size)))


def drifting_clock(lines: Lines, random: random.Random) -> Lines:
    rate = random.choice([1, -1, 30])
    return _times(lines, lambda row, t: t + timedelta(seconds=rate * row))


def another_step(lines: Lines, random: random.Random) -> Lines:
    cut, hours = random.randrange(1, len(lines) + 1), random.choice([1, 2, 5])
    return _times(lines, lambda row, t: t + timedelta(hours=hours * max(0, row - cut)))


def clock_set_back(lines: Lines, random: random.Random) -> Lines:
    cut, hours = random.randrange(1, len(lines) + 1), random.choice([0.3, 1, 5, 24])
    return _times(lines, lambda row, t: t - timedelta(hours=hours * (row > cut)))


def daylight(lines: Lines, random: random.Random) -> Lines:
    cut = datetime.fromisoformat(random.choice(["2020-03-08T02:00", "2020-03-06T02:00"]))
    return _times(lines, lambda row, t: t + timedelta(hours=t.replace(tzinfo=None) >= cut))


def zones(lines: Lines, random: random.Random) -> Lines:
    zone = random.choice(["Z", "+01:00", "-0930", "+99:99"])
    return _times(lines, lambda row, t: t.isoformat() + (zone if random.random() < 0.99 else ""))


def day_first(lines: Lines, random: random.Random) -> Lines:
    form = random.choice(["%d.%m.%Y %H:%M:%S", "%m/%d/%Y %I:%M %p", "%d/%m/%y %H:%M"])
    return _times(lines, lambda row, t: t.strftime(form))


def seconds(lines: Lines, random: random.Random) -> Lines:
    return _times(lines, lambda row, t: str(random.choice([t.timestamp(), row * 3600.0]) if row == 9 else row * 3600))


def wrong_times(lines: Lines, random: random.Random) -> Lines:
    for row in _rows(lines, random, 2):
        lines[row] = random.choice(_STAMPS) + lines[row][lines[row].find(",") :]
    return lines


def dead_sensor(lines: Lines, random: random.Random) -> Lines:
    return _column(lines, random, lambda row, cell: "")


def stuck_sensor(lines: Lines, random: random.Random) -> Lines:
    return _column(lines, random, lambda row, cell: "11.5")


def another_unit(lines: Lines, random: random.Random) -> Lines:
    change = random.choice([lambda t: 1.8 * t + 32, lambda t: t + 273.15, lambda t: 100 * t])
    return _column(lines, random, lambda row, cell: _number(cell, change), share=0.0)


def own_rows(lines: Lines, random: random.Random) -> Lines:
    """A sensor that is logged between the others' rows."""
    offset, found = random.choice([1, 20, 30, 50]), lines[:1]
    for line in lines[1:]:
        cells = line.split(",")
        try:
            later = datetime.fromisoformat(cells[0]) + timedelta(minutes=offset)
        except ValueError:
            return lines
        found.append(",".join([*cells[:-1], ""]))
        found.append(",".join([later.isoformat(), *[""] * (len(cells) - 2), cells[-1]]))
    return found


def sparse_column(lines: Lines, random: random.Random) -> Lines:
    every = random.choice([2, 3, 6, 24])
    return _column(lines, random, lambda row, cell: cell if row % every == 0 else "", share=0.0)


def long_rows(lines: Lines, random: random.Random) -> Lines:
    for row in _rows(lines, random, 2):
        lines[row] += random.choice([",", ",,,", ",7"])
    return lines


def all_rows_longer(lines: Lines, random: random.Random) -> Lines:
    return [line + "," for line in lines]


def short_rows(lines: Lines, random: random.Random) -> Lines:
    for row in _rows(lines, random, 2):
        lines[row] = lines[row][: random.randrange(len(lines[row]) + 1)]
    return lines


def quotes(lines: Lines, random: random.Random) -> Lines:
    for row in _rows(lines, random, 1):
        place = random.randrange(len(lines[row]) + 1)
        lines[row] = lines[row][:place] + '"' + lines[row][place:]
    return lines


def unit_row(lines: Lines, random: random.Random) -> Lines:
    row = random.choice([",°C,°C,°C,°C", "s,degC,degC,degC,degC", ",,,,", "yyyy-mm-dd,K,K,K,K", "TS,°F,°F,°C,C"])
    return [*lines[:1], row, *lines[1:]]


def preamble(lines: Lines, random: random.Random) -> Lines:
    return [random.choice(["Logger 42", '"Plot Title: house"', "", "a,b"]), *lines]


def remarks(lines: Lines, random: random.Random) -> Lines:
    for row in _rows(lines, random, 3):
        lines.insert(row, random.choice([lines[0], "# battery low", "", "End of file,,,,", ",,,,", "   "]))
    return lines


def headers(lines: Lines, random: random.Random) -> Lines:
    changed = random.choice(
        [
            lines[0].replace("T1", "T2"),
            lines[0].replace("T1", "t1 [°C]"),
            lines[0].replace(",", ", "),
            lines[0].upper(),
            "",
            ",".join(f'"{name}"' for name in lines[0].split(",")),
        ]
    )
    return [changed, *lines[1:]]


def no_header(lines: Lines, random: random.Random) -> Lines:
    return lines[1:]


def few_rows(lines: Lines, random: random.Random) -> Lines:
    return lines[: random.choice([0, 1, 2, 9, 20, 60])]


def semicolons(lines: Lines, random: random.Random) -> Lines:
    mark, point = random.choice([(";", ","), (";", "."), ("\t", "."), ("|", ",")])
    return [line.replace(",", mark).replace(".", point) for line in lines]


def quoted_commas(lines: Lines, random: random.Random) -> Lines:
    found = lines[:1]
    for line in lines[1:]:
        first, *cells = line.split(",")
        found.append(",".join([first, *(f'"{cell.replace(".", ",")}"' for cell in cells)]))
    return found


def huge_cell(lines: Lines, random: random.Random) -> Lines:
    return _cells(lines, random, lambda cell: "9" * random.choice([30, 400, 200_000]), most=1)


LINES = (
    words, many_words, empty_cells, spikes, lost_rows, repeated_rows, swapped_rows, blocks_in_another_order,
    newest_first, jitter, drifting_clock, another_step, clock_set_back, daylight, zones, day_first, seconds,
    wrong_times, dead_sensor, stuck_sensor, another_unit, own_rows, sparse_column, long_rows, all_rows_longer,
    short_rows, quotes, unit_row, preamble, remarks, headers, no_header, few_rows, semicolons, quoted_commas,
    huge_cell,
)  # fmt: skip


def _spoilt_bytes(text: str, random: random.Random) -> bytes:
    found = bytearray(text.encode())
    for _ in range(random.randint(1, 20)):
        if found:
            found[random.randrange(len(found))] = random.randrange(256)
    return bytes(found)


def _cut_off(text: str, random: random.Random) -> bytes:
    return text.encode()[: random.randrange(len(text) + 1)]


ENCODINGS: dict[str, Callable[[str, random.Random], bytes]] = {
    "utf-8": lambda text, random: text.encode(),
    "with a byte order mark": lambda text, random: text.encode("utf-8-sig"),
    "utf-16": lambda text, random: text.encode(random.choice(["utf-16", "utf-16-le", "utf-16-be"])),
    "cp1252": lambda text, random: text.encode("cp1252", "replace"),
    "carriage returns": lambda text, random: text.replace("\n", random.choice(["\r", "\r\n"])).encode(),
    "spoilt bytes": _spoilt_bytes,
    "zeros": lambda text, random: text.replace(random.choice("0123456789"), "\0").encode(),
    "cut off": _cut_off,
}
RECORD_KEYS = (
    "", "", "", "", "day_first = true", "day_first = false", 'timezone = "Europe/Berlin"', 'timezone = "UTC"',
    'unit = "degF"', 'unit = "K"', "step = 1800", "step = 7200", "longest_gap = 0", "longest_gap = 50",
    'missing = ["abc", -127, 999.9]', "clean = false", 'decimal = ","', 'separator = ";"', 'encoding = "utf-8"',
)  # fmt: skip


def mutilate(text: str, seed: int, which: list[Callable[[Lines, random.Random], Lines]], encoding: str) -> bytes:
    """A file's content after these mutilations, in their order."""
    source = random.Random(seed)
    lines = text.splitlines()
    for change in which:
        if not lines:
            break
        lines = change(list(lines), source)
    return ENCODINGS[encoding]("\n".join([*lines, ""]) if lines else "", source)
