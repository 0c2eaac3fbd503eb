"""Where in its motion a player is, in words."""

from __future__ import annotations

from robot_ident.excitation.playback import Playback
from robot_ident.playing.player import Phase, Player
from robot_ident.playing.slowed import Slowed


def progress(player: Player) -> str:
    """Return the phase, and while a motion is played its speed and period."""
    if player.phase is not Phase.PLAYING:
        return player.phase.value
    t, played, what = player.elapsed, player.motions[max(player.number, 0)], "playing"
    if isinstance(played, Slowed):
        what = f"playing at {played.speed:.0%}"
        t, played = t * played.speed, played.motion
    if not isinstance(played, Playback):
        return f"{what}, {t:.1f} of {played.duration:.1f} s"
    number = (t - played.transient) / played.excitation.period
    if number < 0:
        return f"{what}, blending in"
    if number >= played.periods:
        return f"{what}, blending out"
    return f"{what}, period {int(number) + 1} of {played.periods}"
