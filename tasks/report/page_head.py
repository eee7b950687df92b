"""The beginning of a page: which scripts may run in it. A page that begins otherwise is not one of this program."""

import base64
import hashlib
from functools import lru_cache
from pathlib import Path

from markupsafe import Markup, escape

from sinew.runner.files import NotReadable, read_regular
from sinew.tasks.study.resources import resource

MAX_BYTES = 2**28  # of a page


@lru_cache(maxsize=1)
def scripts() -> tuple[str, ...]:
    """The scripts of every page: Bokeh's, and the one that puts its plots where they belong."""
    from bokeh.resources import INLINE  # slow to import

    return INLINE.js_raw[0], resource("templates/report.js").read_text("utf-8")


@lru_cache(maxsize=1)
def head() -> Markup:
    """The beginning of a page, up to its Content-Security-Policy.

    These very scripts may run, and nothing may be loaded from anywhere, whatever comes behind it.
    """
    hashes = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts()]
    rules = {
        "default-src": "'none'",
        "script-src": " ".join(f"'sha256-{each}'" for each in hashes),
        "style-src": "'unsafe-inline'",  # Bokeh styles its plots by elements that it makes
        "img-src": "data:",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    policy = escape("; ".join(f"{name} {value}" for name, value in rules.items()))
    return Markup(
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta http-equiv="Content-Security-Policy" content="{}">'
    ).format(policy)


def has_our_head(page: Path) -> bool:
    """Whether a file begins as a page of this program: whoever made it, no other script can run in it.

    No policy stops a page from leading elsewhere by itself, so there is no second ``http-equiv``.
    """
    try:
        content = read_regular(page, MAX_BYTES)
        return content.startswith(str(head()).encode()) and content.lower().count(b"http-equiv") == 1
    except (OSError, NotReadable):
        return False
