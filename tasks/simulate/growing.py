"""How many points a design has as it grows."""

FIRST, GROWTH = 64, 1.5
TURN = 8  # scrambles


def sizes_up_to(most: int, first: int = FIRST) -> list[int]:
    """Sizes of a design that grows, each a multiple of ``TURN`` and about half as large again as the one before."""
    sizes = [TURN * (min(first, most) // TURN)]
    while sizes[-1] + TURN <= most:
        sizes.append(min(TURN * round(GROWTH * sizes[-1] / TURN), TURN * (most // TURN)))
    return sizes
