"""Small workbooks of Excel in its binary formats, .xls and .xlsb, written record by record."""

import struct
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

Rows = Sequence[Sequence[Any]]
SECTOR = 512
FREE, END, FAT = 0xFFFFFFFF, 0xFFFFFFFE, 0xFFFFFFFD
RELATIONS = "http://schemas.openxmlformats.org/package/2006/relationships"
DOCUMENT = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
MAIN_BINARY = "application/vnd.ms-excel.sheet.binary.macroEnabled.main"


# ---- .xls: BIFF8 in a compound file


def xls_stream(
    rows: Rows, codes: Sequence[str] = (), hidden_rows: Sequence[int] = (), hidden: Sequence[int] = ()
) -> bytes:
    """The stream of a workbook with one sheet; ``codes``: the number format of each column; hidden from 0."""

    def record(kind: int, content: bytes = b"") -> bytes:
        return struct.pack("<HH", kind, len(content)) + content

    def text(words: str, size: str) -> bytes:
        return struct.pack(size, len(words)) + b"\1" + words.encode("utf-16-le")

    formats = [record(0x041E, struct.pack("<H", 164 + at) + text(code, "<H")) for at, code in enumerate(codes)]
    styles = [record(0x00E0, struct.pack("<HHH14x", 0, code, 0)) for code in (0, *range(164, 164 + len(codes)))]
    name = b"\3\0one"
    head = record(0x0809, struct.pack("<HHHHII", 0x600, 5, 0, 0, 0, 0))
    font = record(0x0031, struct.pack("<HHHHHBBBB", 200, 0, 0x7FFF, 400, 0, 0, 0, 0, 0) + b"\1\0A")
    before = head + font + b"".join(formats + styles)
    end = record(0x000A)
    place = len(before) + 4 + 6 + len(name) + len(end)
    book = before + record(0x0085, struct.pack("<IH", place, 0) + name) + end
    sheet = record(0x0809, struct.pack("<HHHHII", 0x600, 16, 0, 0, 0, 0))
    sheet += b"".join(record(0x007D, struct.pack("<HHHHHH", at, at, 2000, 0, 1, 0)) for at in hidden)
    sheet += record(0x0200, struct.pack("<IIHHH", 0, len(rows), 0, max(map(len, rows)), 0))
    for at, _ in enumerate(rows):
        flags = 0x120 if at in hidden_rows else 0x100
        sheet += record(0x0208, struct.pack("<HHHHHHHH", at, 0, 9, 300, 0, 0, flags, 15))
    for at, row in enumerate(rows):
        for column, value in enumerate(row):
            style = column + 1 if column < len(codes) else 0
            cell = struct.pack("<HHH", at, column, style)
            if isinstance(value, str):
                sheet += record(0x0204, cell + text(value, "<H"))
            else:
                sheet += record(0x0203, cell + struct.pack("<d", value))
    return book + sheet + end


def write_xls(path: Path, streams: dict[str, bytes]) -> Path:
    """A compound file with these streams in its root."""
    whole = {
        name: content.ljust(-(-max(len(content), 4096) // SECTOR) * SECTOR, b"\0") for name, content in streams.items()
    }
    table, body, first = [FAT, END], [b"", b""], {}
    directory_sectors = -(-(len(whole) + 1) * 128 // SECTOR)
    table[1:] = [*range(2, 1 + directory_sectors), END]
    for name, content in whole.items():
        first[name] = len(table)
        count = len(content) // SECTOR
        table += [*range(len(table) + 1, len(table) + count), END]
        body.append(content)
    assert len(table) <= SECTOR // 4, "one sector of the table is enough"

    def entry(name: str, kind: int, child: int, right: int, start: int, size: int) -> bytes:
        coded = f"{name}\0".encode("utf-16-le")
        return struct.pack(
            "<64sHBBIII16xI8x8xIII", coded, len(coded), kind, 1, FREE, right, child, 0, start, size, 0
        )  # fmt: skip

    entries = entry("Root Entry", 5, 1, FREE, END, 0)
    for at, name in enumerate(whole, start=1):
        entries += entry(name, 2, FREE, at + 1 if at < len(whole) else FREE, first[name], len(whole[name]))
    header = struct.pack(
        "<8s16xHHHHH6xIIIIIIIIII", bytes.fromhex("d0cf11e0a1b11ae1"), 0x3E, 3, 0xFFFE, 9, 6, 0, 1, 1, 0, 4096, END, 0,
        END, 0, 0,
    )  # fmt: skip
    header += struct.pack("<108I", *[FREE] * 108)
    fat = struct.pack(f"<{len(table)}I", *table).ljust(SECTOR, b"\xff")
    path.write_bytes(header + fat + entries.ljust(directory_sectors * SECTOR, b"\0") + b"".join(body))
    return path


# ---- .xlsb: records in an archive


def xlsb_record(kind: int, content: bytes = b"") -> bytes:
    """A record: its kind and its size in 7 bits of each byte, and its content."""
    coded = bytes([kind]) if kind < 128 else bytes([kind & 0x7F | 0x80, kind >> 7])
    size = len(content)
    while True:
        coded += bytes([size & 0x7F | (0x80 if size >> 7 else 0)])
        size >>= 7
        if not size:
            return coded + content


def xlsb_cell(column: int, value: Any, style: int = 0) -> bytes:
    """A number or a text in a cell."""
    head = struct.pack("<II", column, style)
    return (
        xlsb_record(6, head + _wide(value))
        if isinstance(value, str)
        else xlsb_record(5, head + struct.pack("<d", value))
    )


def xlsb_row(number: int, cells: bytes, *, hidden: bool = False) -> bytes:
    """A row, from 0, with its cells."""
    return xlsb_record(0, struct.pack("<IIHBBBI", number, 0, 300, 0, 0x10 * hidden, 0, 0)) + cells


def xlsb_sheet(rows: bytes, columns: bytes = b"") -> bytes:
    """The part of a sheet."""
    size = xlsb_record(148, struct.pack("<IIII", 0, 99, 0, 9))
    return xlsb_record(129) + size + columns + xlsb_record(145) + rows + xlsb_record(146) + xlsb_record(130)


def write_xlsb(path: Path, sheet: bytes, codes: Sequence[str] = (), relations: str = "") -> Path:
    """A workbook with one sheet; style ``n`` has the ``n``-th of the format ``codes``; further ``relations``."""
    formats = b"".join(
        xlsb_record(44, struct.pack("<H", 164 + at) + _wide(code)) for at, code in enumerate(codes)
    )  # fmt: skip
    styles = b"".join(xlsb_record(47, struct.pack("<HH12x", 0, code)) for code in (0, *range(164, 164 + len(codes))))
    parts = {
        "[Content_Types].xml": '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
        f'<Default Extension="bin" ContentType="{MAIN_BINARY}"/></Types>',
        "_rels/.rels": f'<Relationships xmlns="{RELATIONS}"><Relationship Id="r" Type="{DOCUMENT}/officeDocument" '
        'Target="xl/workbook.bin"/></Relationships>',
        "xl/_rels/workbook.bin.rels": f'<Relationships xmlns="{RELATIONS}"><Relationship Id="r1" '
        f'Type="{DOCUMENT}/worksheet" Target="worksheets/sheet1.bin"/><Relationship Id="r2" Type="{DOCUMENT}/styles" '
        f'Target="styles.bin"/>{relations}</Relationships>',
        "xl/workbook.bin": xlsb_record(131) + xlsb_record(143)
        + xlsb_record(156, struct.pack("<II", 0, 1) + _wide("r1") + _wide("one")) + xlsb_record(144) + xlsb_record(132),
        "xl/styles.bin": xlsb_record(278) + xlsb_record(615, struct.pack("<I", len(codes))) + formats + xlsb_record(616)
        + xlsb_record(626, struct.pack("<I", 1)) + xlsb_record(47, struct.pack("<HH12x", 0xFFFF, 10)) + xlsb_record(627)
        + xlsb_record(617, struct.pack("<I", len(codes) + 1)) + styles + xlsb_record(618) + xlsb_record(279),
        "xl/worksheets/sheet1.bin": sheet,
    }  # fmt: skip
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    return path


def _wide(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode("utf-16-le")
