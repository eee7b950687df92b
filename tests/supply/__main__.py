"""What the program is made of: ``python -m tests.supply`` with ``audit [ADVISORIES]``, ``sbom`` or ``requirements``."""

import sys
from pathlib import Path

from tests.supply import audit, lock, sbom

match sys.argv[1:]:
    case ["audit"]:
        sys.exit(audit.audit(None))
    case ["audit", advisories]:
        sys.exit(audit.audit(Path(advisories)))
    case ["sbom", folder]:
        print(sbom.write(Path(folder)))
    case ["requirements", folder]:
        path = Path(folder) / f"sinew_fe-{lock.version()}.requirements.txt"
        path.write_text(lock.of_the_run(lock.LOCK.read_text("utf-8")), "utf-8")
        print(path)
    case _:
        sys.exit("usage: python -m tests.supply audit [ADVISORIES] | sbom FOLDER | requirements FOLDER")
