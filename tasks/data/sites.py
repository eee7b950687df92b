"""The sites of a cohort: specimens that were cut from the same place share one."""

from collections.abc import Iterable

from sinew.tasks.model import Specimen

NO_SITE = "all"


def site_of(specimen: Specimen) -> str:
    """The name of a specimen's site in results; ``all`` for a specimen without one."""
    return specimen.site or NO_SITE


def by_site(specimens: Iterable[Specimen]) -> dict[str, tuple[Specimen, ...]]:
    """Specimens by site, in the order in which the sites first appear."""
    sites: dict[str, list[Specimen]] = {}
    for specimen in specimens:
        sites.setdefault(site_of(specimen), []).append(specimen)
    return {site: tuple(members) for site, members in sites.items()}
