"""What emulators can be, and how large: quick to import, for those who only read what is said of them."""

from typing import Literal

Kind = Literal["chaos", "process"]
KINDS: tuple[Kind, ...] = ("chaos", "process")
COMPONENTS = 12  # principal components of courses, at most
HIGHEST = 10  # degree of polynomials
