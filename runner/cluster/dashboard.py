"""The address of a run's Dask dashboard, which listens on its own machine only, and how to reach it."""

import re
import socket
from collections.abc import Mapping
from typing import Any


def dashboard(client: Any) -> dict[str, Any] | None:
    """``host`` and ``port`` of the dashboard of a Dask client's cluster; None when there is none."""
    port = client.scheduler_info().get("services", {}).get("dashboard")
    return None if port is None else {"host": socket.gethostname(), "port": port}


def way_to(dashboard: Mapping[str, Any] | None, here: str | None = None) -> str | None:
    """How to reach a dashboard from the machine ``here``, or from anywhere; None if host or port are invalid."""
    if dashboard is None:
        return None
    host, port = dashboard.get("host"), dashboard.get("port")
    if not (isinstance(port, int) and isinstance(host, str) and re.fullmatch(r"[A-Za-z0-9._-]{1,255}", host)):
        return None
    if host == here:
        return f"http://127.0.0.1:{port}/status"
    return f"ssh -N -L 8787:127.0.0.1:{port} {host}, then http://127.0.0.1:8787/status"
