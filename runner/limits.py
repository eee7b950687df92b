"""Limits of a process that looks at a file which nobody has checked."""

import resource


def limit(memory_bytes: int, seconds: int) -> None:
    """Limit the memory and the processor time of this process, and let it leave no core."""
    for kind, most in ((resource.RLIMIT_CORE, 0), (resource.RLIMIT_AS, memory_bytes), (resource.RLIMIT_CPU, seconds)):
        hard = resource.getrlimit(kind)[1]
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)  # a limit of the shell may be lower
        resource.setrlimit(kind, (most, most))
