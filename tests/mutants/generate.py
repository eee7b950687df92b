"""Makes the mutants of the working copy in the current folder, and tests none of them."""

from pathlib import Path

from mutmut.__main__ import copy_also_copy_files, copy_src_dir, create_mutants, setup_source_paths


def main() -> None:
    """As ``mutmut run`` begins."""
    Path("mutants").mkdir(exist_ok=True)
    copy_src_dir()
    copy_also_copy_files()
    setup_source_paths()
    create_mutants(1)


if __name__ == "__main__":
    main()
