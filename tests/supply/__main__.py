"""What the program is made of: ``python -m tests.supply audit [ADVISORIES]`` or ``sbom FOLDER``."""

import sys
from pathlib import Path

from tests.supply import audit, sbom

match sys.argv[1:]:
    case ["audit"]:
        sys.exit(audit.audit(None))
    case ["audit", advisories]:
        sys.exit(audit.audit(Path(advisories)))
    case ["sbom", folder]:
        print(sbom.write(Path(folder)))
    case _:
        sys.exit("usage: python -m tests.supply audit [ADVISORIES] | sbom FOLDER")
