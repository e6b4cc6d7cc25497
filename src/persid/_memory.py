"""How much memory there is: of the machine, or what this process or its container may take of it."""

import os
from collections.abc import Iterator
from pathlib import Path

GROUP = Path("/sys/fs/cgroup/memory.max")  # of a container, or "max"
UNKNOWN = 2**33  # bytes, where the system does not say


def memory() -> int:
    """Return the bytes that this process may take at most."""
    return min(_limits(), default=UNKNOWN)


def _limits() -> Iterator[int]:
    if hasattr(os, "sysconf"):
        yield os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    try:
        import resource  # not on Windows

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            yield limit
    except ImportError:
        pass
    text = GROUP.read_text(encoding="utf-8").strip() if GROUP.is_file() else "max"
    if text.isdecimal():
        yield int(text)
