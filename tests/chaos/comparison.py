"""What must be equal after a calm run and after one that was killed again and again: all but what docs list."""

from pathlib import Path

from tests.test_same_bytes import listed


def files(folder: Path) -> dict[str, bytes]:
    """Every file of a result folder that may not differ."""
    found = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    return {name: path.read_bytes() for name, path in sorted(found.items()) if not listed(name)}


def folders(folder: Path) -> set[str]:
    """Every folder below a result folder, but for those in which everything may differ."""
    found = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_dir()}
    return {name for name in found if not listed(f"{name}/file")}


def differences(calm: Path, other: Path) -> list[str]:
    """What is different, in words; empty if nothing is."""
    before, after = files(calm), files(other)
    words = [f"{name} is missing" for name in before if name not in after]
    words += [f"{name} is left over" for name in after if name not in before]
    words += [f"{name} differs" for name in before if name in after and before[name] != after[name]]
    words += [f"the folder {name} is missing" for name in sorted(folders(calm) - folders(other))]
    return words + [f"the folder {name} is left over" for name in sorted(folders(other) - folders(calm))]
