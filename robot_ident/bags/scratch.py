"""A temporary folder that goes when the storage that unpacked something into it goes."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from pathlib import Path

from robot_ident.errors import InputError


class ScratchFolder:
    """A folder under the system's temporary one, removed with this object or at the end of the process."""

    def __init__(self) -> None:
        """Make it; InputError when the disk refuses."""
        try:
            self.path = Path(tempfile.mkdtemp(prefix="robot_ident_"))
        except OSError as error:
            raise InputError(f"{tempfile.gettempdir()}: no temporary folder can be made ({error.strerror})") from error
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)
