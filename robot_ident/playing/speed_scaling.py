"""The speed scaling that a robot tells: its speed slider, as a share or in percent."""

from __future__ import annotations

_EXACT = 1e-3  # of full speed


class SpeedScaling:
    """Keeps what was heard last: a motion is only itself at full speed. '' as topic: none is listened to."""

    def __init__(self, topic: str) -> None:
        """Nothing was heard yet."""
        self._topic = topic
        self._last: float | None = None
        self._percent = False

    def update(self, value: float) -> None:
        """Take in 1 or 100 for full speed; after more than 1 all is percent."""
        self._last = value
        self._percent = self._percent or value > 1.0 + _EXACT

    @property
    def problem(self) -> str:
        """Why the robot does not go at its full speed, as far as is known, or an empty text."""
        if not self._topic:
            return ""
        if self._last is None:
            return f"nothing was heard on {self._topic}"
        full = 100.0 if self._percent else 1.0
        return "" if abs(self._last - full) <= _EXACT * full else f"the robot's speed scaling is {self._last:g}"
