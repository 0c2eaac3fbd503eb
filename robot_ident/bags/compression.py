"""Decompresses what bags hold, within bounds: never more than was announced, and what is left of a torn stream. What
is unpacked into a temporary folder goes with the storage that did so.
"""

from __future__ import annotations

import shutil
import tempfile
import weakref
from contextlib import suppress
from pathlib import Path

from robot_ident.errors import InputError

LARGEST_CHUNK = 1 << 28  # bytes; real chunks have about one megabyte, a larger claim is damage
_RATIO = 250  # a robot at rest, whose stamps alone change, compresses to a thirtieth
_FLOOR = 1 << 26  # bytes that a small file may unfold to whatever its ratio
_FLOOR_OF_MESSAGE = 1 << 14
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_PIECE = 1 << 20


def most(stored: int) -> int:
    """Return to how many bytes a file of `stored` bytes may unfold; no recording does to more."""
    return _FLOOR + _RATIO * stored


def _zstd(data: bytes, size: int) -> bytes:
    import zstandard

    pieces: list[bytes] = []
    got = 0
    stream = zstandard.ZstdDecompressor().stream_reader(data)
    with suppress(zstandard.ZstdError):  # a torn or damaged stream ends here
        while got < size and (piece := stream.read(min(_PIECE, size - got))):
            pieces.append(piece)
            got += len(piece)
    return b"".join(pieces)


def _lz4(data: bytes, size: int) -> bytes:
    import lz4.frame

    stream = lz4.frame.LZ4FrameDecompressor()
    pieces: list[bytes] = []
    got = 0
    with suppress(RuntimeError, EOFError):  # a torn or damaged stream ends here
        for first in range(0, len(data), _PIECE):
            if stream.eof or got >= size:
                break
            pieces.append(stream.decompress(data[first : first + _PIECE], max_length=size - got))
            got += len(pieces[-1])
    return b"".join(pieces)


def _none(data: bytes, size: int) -> bytes:
    return data[:size]


DECOMPRESSORS = {"": _none, "none": _none, "zstd": _zstd, "lz4": _lz4}


def message(data: bytes) -> bytes:
    """Return a message that rosbag2 compressed by itself (`--compression-mode message`, zstd), or any other unchanged.

    What can't be decompressed comes out empty, which no reader takes for a message.
    """
    import zstandard

    if data[: len(ZSTD_MAGIC)] != ZSTD_MAGIC:
        return data
    try:
        size = zstandard.frame_content_size(data)
    except zstandard.ZstdError:
        return b""
    return _zstd(data, size) if 0 <= size <= min(LARGEST_CHUNK, _FLOOR_OF_MESSAGE + _RATIO * len(data)) else b""


def unpack_file(path: Path, to: Path) -> str:
    """Write the content of the .zstd file `path` to `to`; return a note when it breaks off or unfolds to too much."""
    import zstandard

    left = limit = most(path.stat().st_size)
    with path.open("rb") as source, to.open("wb") as sink:
        reader = zstandard.ZstdDecompressor().stream_reader(source, read_across_frames=True)
        try:
            while piece := reader.read(min(_PIECE, left)):
                left -= sink.write(piece)
            if not left and reader.read(1):
                return f"{path.name}: unfolds to more than any recording does; its first {limit} bytes are used"
        except zstandard.ZstdError as error:
            return f"{path.name}: its compression breaks off ({error}); what came before is used"
    return ""


class ScratchFolder:
    """A folder under the system's temporary one, removed with this object or at the end of the process."""

    def __init__(self) -> None:
        """Make it; InputError when the disk refuses."""
        try:
            self.path = Path(tempfile.mkdtemp(prefix="robot_ident_"))
        except OSError as error:
            raise InputError(f"{tempfile.gettempdir()}: no temporary folder can be made ({error.strerror})") from error
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)
