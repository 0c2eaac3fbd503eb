"""Play in the teeth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Course, Effect, Inner, Mathematics, Signals, Torques, scaled
from robot_ident.effects.gap_crossing import Crossing, Drives, Mesh, crossing
from robot_ident.signals.derivatives import derivatives, step
from robot_ident.signals.motion import Array, Motion

_SLOWEST = 1e-3  # Nm/s: a load that changes more slowly takes long to reverse
_BEDDING = 0.2  # of the gap: approach of the flanks until all teeth bear
_MOTION = 0.9  # share of the acceleration's power that is the motion's own, without blows
_BEYOND = 4.0  # times its highest frequency up to which the path is taken for the motion's own
_SHOWN = 40.0  # Hz: to which encoders show how drives give way, on motions that don't repeat
_STEP_AFTER, _STEP_WIDTH = 1.0, 0.095  # of the time of a crossing: of the smooth step that stands for it in designs
_POSES = 100  # along a motion, in which it is looked what a joint feels
_MOST = 0.95  # of the inertia that a joint feels that may be its rotor's


class Backlash(Effect):
    """A gap between the teeth: as the load reverses the motor loses the link, crosses the gap and meets the other flank
    with a blow, under which the drives give way.

    The link behind the gap is a free mass there, and the drives hold their path like springs and dampers of the
    bandwidth `drive` (Nordin and Gutman, "Controlling mechanical systems with backlash: a survey", 2002, for the
    two-mass model): M z'' = F - L, see `gap_crossing`. What drives give is F - L where the path shows nothing of how
    they give way, e; the part that it does show moves the rigid arm already, and is taken off: F - L - D[tau] e.
    `contact`: frequency at which the link rings on a closed flank, with a ratio `damping`. `rotor`: share of what
    the joint feels before the gap, where the robot's description doesn't tell its armature. `share` is 1 where gap and
    rigid arm are what they are taken for. `gap` is the free play: of flanks that give way softly at first it comes out
    below what slack measured at rest tells, by up to two fifths, which its interval doesn't count.
    """

    name = "backlash"
    equation = "share (F - L - D[tau] e), M dd z = F(z - e, gap) - L, kd de + kp e = L - F"
    meaning = "blow of a gear's play that is crossed when the load reverses"
    coefficients = (Coefficient("share", "Nm/Nm", "N/N", positive=True),)
    inner = (
        Inner("gap", "mrad", "mm", 0.03, 8.0, (0.25, 0.6, 1.4, 3.2), logarithmic=True, defining=True),
        Inner("contact", "Hz", "Hz", 4.0, 100.0, (20.0,), logarithmic=True),
        Inner("drive", "Hz", "Hz", 2.0, 100.0, (8.0, 50.0), logarithmic=True),
        Inner("damping", "", "", 0.02, 0.6, (0.1,), logarithmic=True),
        Inner("rotor", "", "", 0.0, 0.5, (0.02, 0.2)),
    )
    symmetry = "memory"
    signature = "bursts above 5 Hz after the load reverses"
    confused_with = ("joint_elasticity", "presliding")
    also_like = ("flexibility of the mesh",)
    experiment = "choose postures that preload the gear: without a reversal of the load the bursts go"
    magnitude = "gap 0.3-3 mrad: bursts of 1-20 / 0.1-2 Nm"
    uses_torque = True
    needs_time = True
    symbolic = False
    brief = True
    regression = False
    evidence = (
        "a third or more of the residual's energy lies above 5 Hz, most of that after load reversals, as its column;"
        " or its column explains most of what a joint lacks, clearly more than any effect does"
    )

    def placed_inner(self) -> tuple[Inner, ...]:
        """Return the inner parameters, without `rotor` where the armature is known."""
        return tuple(
            inner for inner in super().placed_inner() if inner.name != "rotor" or not self.robot.known_rotor(self.joint)
        )

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return what drives give in addition, Nm, but for what the motion shows of how they give way."""
        if torques is None or torques.rigid is None:
            return np.zeros((motion.samples, self.robot.n, 1))
        found = self._crossing(motion, torques)
        shown = _shown(found.yielded, motion)
        moved = torques.rigid.displaced(Motion(shown, *derivatives(shown, motion)))
        return np.asarray((found.torque - moved)[:, :, None])

    def _crossing(self, motion: Motion, torques: Torques) -> Crossing:
        assert torques.rigid is not None
        joint, inertia = self.joint, torques.rigid.inertia.copy()
        felt = _felt(inertia[:: max(1, motion.samples // _POSES)])
        own = self._usual(np.median(np.diagonal(inertia, axis1=1, axis2=2), axis=0), self._described)
        free = self._usual(np.median(felt, axis=0), _felt(self._inertia[None])[0])[joint]
        most = _MOST * min(float(felt[:, joint].min()), float(own[joint]))
        rotor = min(self.robot.known_rotor(self.joint) or float(self.setting["rotor"] * free), most)
        own_path = _without_blows(motion)
        apart = Motion(*(getattr(motion, part) - getattr(own_path, part) for part in ("q", "dq", "ddq")))
        load = torques.load[:, joint] - torques.rigid.displaced(apart)[:, joint] - rotor * own_path.ddq[:, joint]
        inertia[:, joint, joint] -= rotor
        link, w = own[joint] - rotor, 2.0 * np.pi * self.setting["contact"]
        gap = 1e-3 * self.setting["gap"]
        mesh = Mesh(gap, _BEDDING * gap, link * w**2, 2.0 * self.setting["damping"] * link * w)
        drives = Drives.of_bandwidth(self.setting["drive"], own)
        return crossing(joint, load, inertia, mesh, drives, step(motion), periodic=motion.periodic)

    def _usual(self, along: Array, described: Array) -> Array:
        """Return the inertia [n] that each joint usually moves: the same for all motions, as drives and teeth are.

        What is `described` of the robot at mid range; of joints of which nothing is told, the median `along` the
        motion.
        """
        told = (described > 0.0) & [not self.robot.in_ampere(j) for j in range(self.robot.n)]
        return np.where(told, described, np.maximum(along, 1e-6 * max(float(along.max()), 1e-12)))

    @property
    def _described(self) -> Array:
        return np.diag(self._inertia)

    @cached_property
    def _inertia(self) -> Array:
        """Inertia matrix [n, n] of the robot's description at mid range, armature included."""
        n, limits = self.robot.n, self.robot.limits
        middle = (limits.lower + limits.upper) / 2
        q = np.tile(np.where(np.isfinite(middle), middle, 0.0), (n + 1, 1))
        torque = self.robot.rigid.inverse_dynamics(Motion(q, np.zeros((n + 1, n)), np.eye(n + 1, n)))
        return np.asarray(torque[:n] - torque[n])

    def smooth_terms(self, x: Signals, m: Mathematics, course: Course) -> Sequence[dict[int, Any]]:
        """Return -gap D[tau] of the link's step from one flank to the other under a load that reverses at a rate dtauL:
        tanh((t - t0) / w) / 2 with t - t0 = tauL / dtauL - T after T = (6 M gap / |dtauL|)^(1/3), as sharp as makes the
        power of the blow right. Its place and size hold, not the ringing after it.
        """
        load = x.load[self.joint]
        rate, gap = course.rate(load), 1e-3 * self.setting["gap"]
        slope = m.sqrt(rate**2 + _SLOWEST**2)
        inertia = m.fabs(course.displaced(self.joint, (0.0, 0.0, 1.0))[self.joint])
        within = (6.0 * gap * inertia / slope) ** (1.0 / 3.0)
        onward, steep = rate / slope, 1.0 / (_STEP_WIDTH * within)
        side = m.tanh(steep * (load * rate / slope**2 - _STEP_AFTER * within))
        first = steep * (1.0 - side**2)
        second = -2.0 * steep * side * first
        step_of_link = [0.5 * onward * part for part in (side, first, second)]
        return [scaled(-gap, course.displaced(self.joint, step_of_link))]


def _felt(inertia: Array) -> Array:
    """Return what each joint feels of an inertia matrix [N, n, n] while the others give way, 0 where that is none."""
    out = np.zeros(inertia.shape[:2])
    regular = np.linalg.eigvalsh(inertia)[:, 0] > 0.0
    out[regular] = 1.0 / np.diagonal(np.linalg.inv(inertia[regular]), axis1=1, axis2=2)
    return out


def _without_blows(motion: Motion) -> Motion:
    """Return the motion without what blows make of it: up to 4 times the frequencies that hold 90 % of the
    acceleration's power.
    """
    rates = np.fft.rfftfreq(motion.samples, step(motion))
    power = np.abs(np.fft.rfft(motion.ddq, axis=0)) ** 2
    power = np.cumsum(np.sum(power / np.maximum(power.sum(axis=0), 1e-300), axis=1))
    cutoff = _BEYOND * float(rates[min(int(np.searchsorted(power, _MOTION * power[-1])), len(rates) - 1)])
    if not 0.0 < cutoff < 0.8 * rates[-1]:
        return motion

    def slow(x: Array) -> Array:
        if motion.periodic:
            lines = np.fft.rfft(x, axis=0)
            lines[rates > cutoff * (1.0 + 1e-9)] = 0.0
            return np.fft.irfft(lines, len(x), axis=0)
        from scipy.signal import butter, sosfiltfilt

        sections = butter(4, cutoff, fs=1.0 / step(motion), output="sos")
        return np.asarray(sosfiltfilt(sections, x, axis=0, padlen=min(27, len(x) - 1)))

    return replace(motion, q=slow(motion.q), dq=slow(motion.dq), ddq=slow(motion.ddq))


def _shown(yielded: Array, motion: Motion) -> Array:
    """Return what a motion shows of how drives give way [N, n]: of a periodic one no more of a line than it holds."""
    if motion.periodic:
        lines, held = np.fft.rfft(yielded, axis=0), np.abs(np.fft.rfft(motion.q, axis=0))
        share = np.minimum(1.0, held / np.maximum(np.abs(lines), 1e-300))
        return np.fft.irfft(share * lines, motion.samples, axis=0)
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(yielded, 1.0 / (2.0 * np.pi * _SHOWN * step(motion)), axis=0, mode="nearest"))
