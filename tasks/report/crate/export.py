"""One file, or folder, with a study and all that a stranger needs to check it and to run it again."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sinew.runner.errors import SinewError, one_line
from sinew.runner.files import read_input
from sinew.tasks.cluster.profile import read_profile
from sinew.tasks.report.crate import environment
from sinew.tasks.report.crate.contents import cohort_items, result_items, strangers, study_items, table_items
from sinew.tasks.report.crate.layout import Layout, changed_fields, layout_of
from sinew.tasks.report.crate.metadata import METADATA, Person, metadata
from sinew.tasks.report.crate.methods import methods
from sinew.tasks.report.crate.pack import Item, packed, packing, refuse_taken
from sinew.tasks.report.crate.readme import readme
from sinew.tasks.report.crate.source import Source, read_source
from sinew.tasks.report.status import PAGE, current_page

SUMS = "sha256sums.txt"
MAX_PROFILE_BYTES = 2**20


@dataclass(frozen=True)
class Exported:
    """A crate that was written: its ``files`` and their ``bytes``, and lines that a person should read."""

    path: Path
    files: int
    bytes: int
    remarks: tuple[str, ...]


def export(
    folder: Path,
    out: Path | None = None,
    *,
    store: bool = False,
    study: Path | None = None,
    data: Path | None = None,
    profile: Path | None = None,
    licence: str | None = None,
    authors: Sequence[Person] = (),
) -> Exported:
    """Write the crate of a result folder: a zip if ``out`` ends in .zip (default: NAME.crate.zip), else a folder.

    The same folder gives the same bytes. ``store`` adds all evaluations and the log. ``study``, ``data``: where study
    file and cohort lie now. Raises :class:`sinew.runner.errors.SinewError`, before anything is written where input is
    wrong.
    """
    out = out or Path(f"{folder.resolve().name}.crate.zip")
    refuse_taken(out)
    source = read_source(folder, study, data)
    layout = layout_of(source)
    items = [
        *study_items(source, layout),
        *cohort_items(source, layout),
        *result_items(source, layout, store=store),
        *_profile(profile),
        *_written(source, layout, store=store),
    ]
    with packing(out) as put:
        files = packed(items, put)
        sums = "".join(f"{one.sha256}  {one.item.name}\n" for one in files)
        files += packed([Item(SUMS, sums.encode(), "SHA-256 of all files but this and the description")], put)
        described = metadata(source, layout, files, licence=licence, authors=authors)
        files += packed([Item(METADATA, described, "description of the crate")], put)
    return Exported(out, len(files), sum(one.bytes for one in files), tuple(_remarks(source, licence)))


def _written(source: Source, layout: Layout, *, store: bool) -> list[Item]:
    """What is written for the crate. Raises ``SinewError`` where a result or the log contradicts itself."""
    try:
        return [
            *table_items(source),
            Item("environment/environment.json", environment.as_json(source), "versions and hashes of the run"),
            Item("environment/requirements.txt", environment.requirements(source), "versions of packages, for pip"),
            Item("METHODS.md", methods(source), "words for a methods section, with references"),
            Item("README.md", readme(source, layout, store=store), "what is here, and how to run it again"),
        ]
    except (SinewError, OSError):
        raise
    except Exception as error:  # fields that are right one by one may contradict each other
        what = one_line(f"{type(error).__name__}: {error}")[:100]
        raise SinewError(
            f"{source.found.folder}: its results or its log contradict themselves ({what}); run the study again"
        ) from error


def _profile(profile: Path | None) -> list[Item]:
    if profile is None:
        return []
    read_profile(profile)
    content = read_input(profile, MAX_PROFILE_BYTES, "a profile")
    return [Item("profile.yaml", content, "profile of the cluster")]


def _remarks(source: Source, licence: str | None) -> list[str]:
    places = [f"study: {source.study.path}"]
    places += [f"cohort: {source.cohort_folder}"] if source.cohort_folder is not None else []
    changed = changed_fields(source, layout_of(source))
    places += [f"changed in the study file: {', '.join(changed)}"] if changed else []
    places += [f"left out, no task wrote it: {name}" for name in strangers(source.found.folder)]
    if current_page(source.found.folder) is None:
        places.append(f"{PAGE} is missing or older than a result; `sinew report {source.found.folder}` writes it")
    if licence is None:
        places.append("no licence is named (--license): nobody knows what may be done with these data")
    return places
