"""Memory: an allocation beyond what is free fails with one line, before the kernel ends a process of this machine."""

from __future__ import annotations

import ctypes
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

OUT_OF_MEMORY = (
    "this needs more memory than the machine has free; nothing was written. End other programs, or give fewer or"
    " shorter recordings"
)
_MMAP_THRESHOLD = -3  # of malloc.h
_OWN = Path("/proc/self/status")
_MACHINE = Path("/proc/meminfo")
_GROUP = Path("/sys/fs/cgroup")  # as a container sees its own


@contextmanager
def bounded() -> Iterator[None]:
    """Limit this process, and each that it starts, to the memory that it holds and that is free now.

    Linux's RLIMIT_DATA; a lower limit that stands already is kept, and the former one comes back at the end. Raises
    nothing itself: what is allocated beyond raises MemoryError. Large arrays go back to the machine once they are
    freed, from here on.
    """
    _give_back()
    free = available()
    if free is None:
        yield
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limit = _entry(_OWN, "VmData") + free
    known = [value for value in (soft, hard) if value != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_DATA, (min([limit, *known]), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def _give_back() -> None:
    """Have glibc map arrays from a mebibyte on, as at its start: else it keeps up to 32 MiB of each for the next one,
    in pieces that come to hundreds of megabytes.
    """
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL(None).mallopt(_MMAP_THRESHOLD, 1 << 20)


def available() -> int | None:
    """Return the bytes that this process can take before the kernel runs out of them; None where nothing tells."""
    if sys.platform != "linux" or not (free := _entry(_MACHINE, "MemAvailable")):
        return None
    free += _entry(_MACHINE, "SwapFree")
    try:
        most = int((_GROUP / "memory.max").read_text())
        held = int(re.findall(r"^anon (\d+)$", (_GROUP / "memory.stat").read_text(), re.MULTILINE)[0])
    except (OSError, ValueError, IndexError):  # no group, none with a limit ("max"), or one of the first version
        return free
    return min(free, max(most - held, 0))


def _entry(path: Path, name: str) -> int:
    """Return an entry of a table of the kernel [bytes], 0 where it has none."""
    try:
        found = re.search(rf"^{name}:\s+(\d+) kB$", path.read_text(), re.MULTILINE)
    except OSError:
        return 0
    return 1024 * int(found[1]) if found else 0
