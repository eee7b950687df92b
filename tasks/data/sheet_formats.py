"""How the cells of a spreadsheet are shown, and what of it is hidden: what the library that reads it does not tell.

This runs in the process of :mod:`sinew.tasks.data.sheet_reading`, which has limits.
"""

import io
import zipfile

from sinew.tasks.data.binary_excel_formats import looks_of_xlsb
from sinew.tasks.data.excel_formats import AS_EXCEL, looks_of_xlsx, main_part
from sinew.tasks.data.old_excel_formats import looks_of_xls
from sinew.tasks.data.open_document_formats import looks_of_ods
from sinew.tasks.data.sheet_look import Look, TooMuch

ARCHIVE, OLE = b"PK", bytes.fromhex("d0cf11e0")  # what a file begins with: all kinds but .xls, and .xls
KINDS = ("xl/workbook.xml", "xl/workbook.bin", "content.xml")  # the part that only one kind has


def looks_of(content: bytes) -> dict[str, Look]:
    """How sheets are shown, by their names. Raises :class:`TooMuch`."""
    if content.startswith(OLE):
        return looks_of_xls(content)
    if not content.startswith(ARCHIVE):
        raise ValueError("its first bytes are not those of a spreadsheet")
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        # as whoever reads the numbers finds them
        members = {name.lower().replace("\\", "/"): name for name in archive.namelist()}
        if len(members) < len(archive.namelist()):
            raise TooMuch("two members with the same name", "another name for each")
        main = main_part(archive, members)
        if main is not None and main in members and main not in KINDS:
            raise TooMuch(f"a workbook in its part {main[:60]}", f"{AS_EXCEL}, with the workbook in {KINDS[0]}")
        kinds = [part for part in KINDS if part in members]
        if len(kinds) != 1 or main not in (None, kinds[0]):
            raise ValueError(f"an archive with {' and '.join(kinds) or 'no workbook'}")
        if kinds == ["content.xml"]:
            return looks_of_ods(archive, members)
        of_kind = looks_of_xlsx if kinds == ["xl/workbook.xml"] else looks_of_xlsb
        return of_kind(archive, members)
