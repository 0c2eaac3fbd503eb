"""Is the effort that of this arm in this motion, as its YAML declares it? Noise, absolute values, another joint's
effort, another gravity; `contradictions` asks all of it.

Each joint's effort is held against what its motion can make of it,

    tau_j = s_j I_j(q, dq, ddq) + G_j(q) + b dq_j + c sign(dq_j) + o + r ddq_j,

I_j the URDF's inertial torque and G_j that of its weight: `gravity` tries every gravity in G, `foreign` every sign of
tau, `exchanged` every joint's right-hand side.

Hobby servos report how hard they push, and not which way. A recording's efforts belong to its positions where no other
shift of time explains them better, all joints together. Weight knows no time and inertia goes with the square of its
scale, so that two recordings of one arm whose weights are alike and whose inertias differ by one factor on every joint
were stamped by clocks of different pace.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.contradiction import Contradiction, contradiction, coupling_contradiction, weight_removed
from robot_ident.estimation.declaration import (
    Declared,
    at_all_rows,
    by_clock,
    clustered,
    judge_all,
    judge_measured,
    scale_notes,
)
from robot_ident.recording.conditions import sidecar
from robot_ident.recording.effort import EXPLAINED, folded_back, one_sided
from robot_ident.recording.measurement import Measurement, beyond_base, with_payload
from robot_ident.regression.block_jackknife import rows_in_block
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

_NOTHING = 0.05  # of an effort's power that its motion must explain
_SEEN = 4.0  # standard deviations from which on weight, inertia or friction is seen in an effort
_FITS = 0.8  # of an effort that must be explained before anything is said about what it is
_FOLLOWS = 0.9  # of an effort that another joint's motion must explain
_MUCH_LESS = 0.25  # of what its own motion leaves over, that it may leave
_LEAST_INERTIA = 0.3  # share of the URDF's inertial torque: below it, effort is no torque or has another sign
_AS_WELL = 1.15  # times what is left over where each joint may have a share of the declared weight
_ALSO = 0.1  # of the effort that weight may make: URDFs' masses are not all wrong by one factor
_ALIKE = 0.003  # of an effort, by which two readings of it may differ and say nothing
_FACTOR = 3.0  # by which masses of a URDF may be wrong, or a payload adds to them that nobody stated
_LITTLE = 3.0  # m/s^2 that an arm without weight may seem to feel
_MOST = 15.0  # m/s^2 that an arm may seem to feel, on Earth or elsewhere
_TILT = 0.5  # rad by which a base may stand tilted
_SURE = 6.0  # standard deviations
_AS_DECLARED = "; taken as declared"
_ROWS = 4000  # that are looked at, at most
_MOVES = 0.02  # rad or m
_TURNED = 0.1  # share of the samples whose sign is lost
_BETTER = 0.3  # of the power left over before, that may be left over by a better reading
_TOUCHES = 0.05  # of the largest effort, to which an absolute value falls where its torque turns
_CLOSE = 0.25  # s; a delay or a drive's lag up to that is an effect of the robot, not another time
_OF_CLOCK = 0.1  # of what inertia in common leaves beyond own ones, that the pace of a clock must explain
_TIMELESS, _TIMED = [0, 3, 5], [1, 2, 4]  # columns of a joint
_CLEARLY = 0.9  # of what is left over as stamped, that another shift leaves at most: a motion that repeats ties


def contradictions(
    measurements: Sequence[Measurement],
    robot: Robot,
    *,
    as_declared: bool = False,
    otherwise: str = "",
    loaded: bool = False,
) -> list[str]:
    """Return what in the data contradicts the declaration of effort, for the notes of a model.

    Raises InputError, with the line of the robot YAML to change, unless the user goes on all the same (as_declared); of
    a clock that runs wrong no line tells, and it is only said. Where nothing contradicts it once stated payloads are
    left out, the sidecars that state them are named instead. otherwise: what else the user may do. Recordings with an
    unknown payload are not judged; of those that are `loaded` with what is to be found, only whether the motion made
    their efforts: a gain can't be told from a load.
    """
    measurements = [m for m in measurements if not m.conditions.estimated]
    if not measurements:
        return []
    checks = EffortChecks(measurements, robot)
    foreign = checks.foreign() or checks.exchanged() or checks.clocks_apart()
    if foreign and as_declared:
        return [f"{foreign}{_AS_DECLARED}"]
    if foreign:
        raise InputError(f"{foreign}{otherwise}")
    if loaded:
        return []
    found = checks.declaration()
    if found is None:
        return scale_notes(measurements, robot)
    if as_declared:
        return [f"{found.in_words}{_AS_DECLARED}"]
    stated = {str(sidecar(m.source)): m.conditions.payload for m in measurements if m.conditions.payload is not None}
    if stated and contradiction(judge_all([with_payload(m, robot) for m in measurements], robot), robot) is None:
        told = ", ".join(f"{file}: payload.mass = {one.mass:g}" for file, one in stated.items())
        raise InputError(
            f"{told}: the effort contradicts this payload; mass is in kg, centre in m in the end effector's frame"
            f"{otherwise}"
        )
    raise InputError(f"{found.told(robot)}{otherwise}")


def taken_as_declared(notes: Sequence[str]) -> bool:
    """Return whether a model with these notes was identified against a contradiction that its user went on with."""
    return any(note.endswith(_AS_DECLARED) for note in notes)


class EffortChecks:
    """What efforts of some recordings are, each held against what its motion can make of it."""

    def __init__(self, measurements: Sequence[Measurement], robot: Robot) -> None:
        """Compute the torques of the URDF along the motions."""
        self._robot = robot
        self._measured = [(measured, EffortRows(measured, robot)) for measured in measurements]

    def foreign(self) -> str:
        """Return which joints' efforts are none of this motion, in a sentence that says what they look like; or ""."""
        return self._first(_not_of_this_motion)

    def clocks_apart(self) -> str:
        """Return which recordings' clocks run at different paces, in a sentence, loaded ones left out; or nothing."""
        told = [x for x in self._measured if x[0].conditions.payload is None and not x[0].conditions.estimated]
        if len(told) < 2:
            return ""
        return paces_apart([rows for _, rows in told], [judge_measured(m, self._robot) for m, _ in told])

    def exchanged(self) -> str:
        """Return which joints' efforts follow each other's motion, in a sentence; or nothing."""
        return "" if self._robot.effort.coupling is not None else self._first(_exchanged)

    def _first(self, look: Callable[[EffortRows], list[str]]) -> str:
        """Return what a look at the recordings says of the first one of which it says something."""
        told = ((measured.source, look(rows)) for measured, rows in self._measured)
        return next((f"{source}: {'; '.join(words)}" for source, words in told if words), "")

    def declaration(self) -> Contradiction | None:
        """Return which entry on effort the data contradict: its coupling, gravity, or sign, side and unit; or None."""
        measurements, robot = [measured for measured, _ in self._measured], self._robot
        first = coupling_contradiction(measurements, robot) or self.gravity()
        if first is not None and not first.of_weight:
            return first
        found = contradiction(judge_all(measurements, robot), robot)
        return first if found is None or (first is not None and not found.of_weight) else found

    def gravity(self) -> Contradiction | None:
        """Return what the efforts say of gravity where that is far from what is declared, by the robot YAML or a
        recording's conditions, or None.

        g [3] m/s^2 is fitted to all joints at once, tau_j = s_j I_j + sum_k g_k G_jk + ... Only what two joints or
        more tell counts, and only where one gravity explains their efforts as well as a share of the declared weight
        by joint does: a counterbalance on one of them is no other gravity. Next to no gravity is weight that the driver
        takes out. An unknown payload tells nothing.
        """
        if any(self._robot.effort.of(joint).gravity == "removed" for joint in self._robot.joints):
            return None
        for measured, rows in self._measured:
            found = None if measured.conditions.estimated else _gravity(rows)
            if found is not None:
                stated = measured.conditions.gravity is not None and not found.of_weight
                return replace(found, file=str(sidecar(measured.source))) if stated else found
        return None


def undecided_directions(measured: Measurement, robot: Robot) -> str:
    """Return which joints may turn the other way round, position and effort both, in a sentence; or nothing.

    A mirrored arm obeys the same equations: where turning a joint round explains the efforts of all as well, no data
    tell which way it turns.
    """
    if robot.effort.coupling is not None:
        return ""
    rows, alike = EffortRows(measured, robot), []
    left = _left(rows)
    for joint in rows.moving:
        turn, motion = np.where(np.arange(robot.n) == joint, -1.0, 1.0), measured.motion
        turned = replace(motion, q=motion.q * turn, dq=motion.dq * turn, ddq=motion.ddq * turn)
        other = EffortRows(replace(measured, motion=turned, torque=measured.torque * turn), robot)
        if _left(other) < _AS_WELL * left + _ALIKE:
            alike.append(robot.joints[joint])
    if not alike:
        return ""
    return (
        f"these data can't tell which way {', '.join(alike)} turn{'s' * (len(alike) == 1)}: position and effort turned"
        " round together fit as well; compare a motion of the robot with the URDF's axis"
    )


def _left(rows: EffortRows) -> float:
    """Return what own motions leave of the joints' efforts, in parts of their power."""
    return sum(1.0 - _explained(*rows.of(joint), rows.block)[0] for joint in rows.moving)


def _not_of_this_motion(rows: EffortRows) -> list[str]:
    """Say which joints' efforts are none of this motion, or have lost their sign: of all of them at once."""
    lost, names = _unsigned_joints(rows), rows.robot.joints
    nothing = []
    for joint in rows.moving:
        explained, seen = _explained(*rows.of(joint), rows.block)
        if joint not in lost and explained < _NOTHING and seen < _SEEN:
            nothing.append(f"{names[joint]} ({100 * max(explained, 0.0):.1f} %)")
    sentence = (
        f"the effort of {', '.join(nothing)} is not made by the motion (noise, or that of another run): weight, inertia"
        " and friction explain no more of it than chance does; record motion and effort together"
    )
    noise = [sentence] if nothing else []
    if lost:
        return [*noise, _in_words([names[joint] for joint in lost], all_moving=len(lost) == len(rows.moving))]
    return _out_of_step(rows) or noise


def _explained(columns: Array, tau: Array, block: int) -> tuple[float, float]:
    """Return the share of an effort's power about its mean that columns, an offset last, explain, and by how many
    standard deviations the surest of them is seen.
    """
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 1e-9 * size.max()] / size[size > 1e-9 * size.max()]
    solved, *_ = np.linalg.lstsq(scaled, tau, rcond=1e-9)
    left = tau - scaled @ solved
    power = float(np.sum((tau - tau.mean()) ** 2))
    spread = np.sqrt(np.maximum(np.diag(clustered(scaled, left, block)), 1e-300))
    return 1.0 - float(left @ left) / power if power > 0 else 0.0, float(np.abs(solved[:-1] / spread[:-1]).max())


def _exchanged(rows: EffortRows) -> list[str]:
    """Say which joints' efforts follow each other's motion."""
    share = {
        joint: {other: _explained(*rows.of(other, joint), rows.block)[0] for other in rows.moving}
        for joint in rows.moving
    }
    follows = {joint: max(found, key=lambda other: found[other]) for joint, found in share.items()}
    names, told = rows.robot.joints, []
    for joint, other in follows.items():
        own, best = share[joint][joint], share[joint][other]
        if follows[other] != other and best > _FOLLOWS and 1.0 - best < _MUCH_LESS * (1.0 - own):
            told.append(
                f"the effort of {names[joint]} follows the motion of {names[other]}, which explains {100 * best:.1f} %"
                f" of it, rather than its own ({100 * max(own, 0.0):.1f} %)"
            )
    return [*told, "exchange the names of these efforts"] if len(told) > 1 else []


@dataclass(frozen=True)
class _Loaded:
    """A joint that weight loads: weight [K, 3] per m/s^2 and effort [K] beside what its drive can make, over the
    residual's standard deviation. inertia: its share of the URDF's inertial torque, nan where it isn't seen. sound:
    whether its inertia, or else its friction, has the sign that it must have.
    """

    weight: Array
    tau: Array
    inertia: float
    sound: bool

    def left(self, gravity: Array) -> float:
        """Return what a gravity [3] m/s^2 leaves of the effort."""
        return float(np.sum((self.tau - self.weight @ gravity) ** 2))


def _gravity(rows: EffortRows) -> Contradiction | None:
    loaded = [one for joint in rows.moving if (one := _loaded(rows, joint)) is not None]
    if len(loaded) < 2 or not all(one.sound for one in loaded):
        return None
    weight, tau = np.vstack([one.weight for one in loaded]), np.concatenate([one.tau for one in loaded])
    inverse = np.linalg.pinv(weight.T @ weight)
    found = inverse @ weight.T @ tau
    pieces = []
    for one in loaded:
        own = one.weight @ rows.gravity
        share = rows.gravity * float(own @ one.tau) / max(float(own @ own), 1e-300)
        if one.left(found) > _AS_WELL * one.left(share) + _ALSO * float(one.tau @ one.tau):
            return None
        single = one.weight * (one.tau - one.weight @ found)[:, None]
        pieces += np.array_split(single, len(one.tau) // rows.block + 2)
    scores = np.array([piece.sum(axis=0) for piece in pieces])
    covariance = inverse @ (scores.T @ scores) @ inverse
    seen = [one.inertia for one in loaded if np.isfinite(one.inertia)]
    scale = float(np.median(seen)) if seen else 1.0
    near = _near(rows.gravity)
    # a gain of the effort enlarges weight and inertia alike, a wrong inertia of the URDF the one alone
    for size in (1.0, scale):
        apart = found / size - near
        far = np.einsum("ki,ij,kj->k", apart, np.linalg.pinv(covariance / size**2), apart).min() > _SURE**2
        if _is_near(found / size, rows.gravity) or not far:
            return None
    found = min((found, found / scale), key=lambda gravity: abs(np.log(np.linalg.norm(gravity) / 9.81)))
    if np.linalg.norm(found) > _MOST:
        return None  # no arm is as heavy: a joint that counts the other way round, say, of which others tell
    if np.linalg.norm(found) < _LITTLE:
        return weight_removed(rows.robot, f"weight is that of {np.linalg.norm(found):.2g} m/s^2")
    readings = (rows.gravity, 3), (_plain(found), 3), (found, 2)
    now, best, told = (f"[{', '.join(f'{value:.{digits}g}' for value in g)}]" for g, digits in readings)
    return Contradiction("gravity", now, f"gravity: {best}", {}, f"weight is that of {told} m/s^2")


def _loaded(rows: EffortRows, joint: int) -> _Loaded | None:
    """Return a joint on which weight shows; None where it doesn't, or where effort is no torque."""
    if rows.robot.in_ampere(joint):
        return None
    used = rows.used[:, joint]
    drive, weight, tau = rows.drive[used, joint], rows.weight[used, joint], rows.tau[used, joint]
    q, _ = np.linalg.qr(drive / np.maximum(np.linalg.norm(drive, axis=0), 1e-12))
    apart, beside = weight - q @ (q.T @ weight), tau - q @ (q.T @ tau)
    columns = np.column_stack([weight, drive])
    solved, *_ = np.linalg.lstsq(columns, tau, rcond=1e-9)
    left = tau - columns @ solved
    spread = np.linalg.pinv(clustered(apart, left, rows.block))
    if solved[:3] @ spread @ solved[:3] < _SEEN**2 or float(left @ left) > (1.0 - _FITS) * float(tau @ tau):
        return None
    noise = float(np.sqrt(np.mean(left**2))) or 1.0
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    std = float(np.sqrt(max(clustered(columns / size, left, rows.block)[3, 3], 0.0))) / float(size[3])
    seen = abs(solved[3]) > _SEEN * std
    braking = float(drive[:, 1] @ (drive[:, 1:3] @ solved[4:6])) > 0.0
    sound = solved[3] > _LEAST_INERTIA if seen else braking
    return _Loaded(apart / noise, beside / noise, float(solved[3]) if seen else float("nan"), bool(sound))


def _is_near(found: Array, declared: Array) -> bool:
    """Return whether a gravity may be a declared one: masses of URDFs are wrong, payloads unstated, bases tilted."""
    size, other = float(np.linalg.norm(found)), float(np.linalg.norm(declared))
    if not other:
        return size < _LITTLE
    return float(found @ declared) > np.cos(_TILT) * size * other and 1.0 / _FACTOR < size / other < _FACTOR


def _near(declared: Array) -> Array:
    """Return gravities [K, 3] at the bounds of `_is_near` and within."""
    size = float(np.linalg.norm(declared))
    if not size:
        return np.zeros((1, 3))
    down = declared / size
    side = np.cross(down, (1.0, 0.0, 0.0) if abs(down[0]) < 0.9 else (0.0, 1.0, 0.0))
    side = side / np.linalg.norm(side)
    across = [np.cos(turn) * side + np.sin(turn) * np.cross(down, side) for turn in np.arange(12) * np.pi / 6.0]
    directions = [down, *(np.cos(tilt) * down + np.sin(tilt) * one for tilt in (_TILT / 2, _TILT) for one in across)]
    return size * np.array([factor * one for factor in np.geomspace(1.0 / _FACTOR, _FACTOR, 15) for one in directions])


def _plain(gravity: Array) -> Array:
    """Return Earth's gravity along the axis of the base that is nearest, where one is near."""
    size = float(np.linalg.norm(gravity))
    axis = int(np.argmax(np.abs(gravity)))
    if abs(gravity[axis]) < np.cos(np.deg2rad(25.0)) * size or not 1.0 / _FACTOR < size / 9.81 < _FACTOR:
        return gravity
    return np.where(np.arange(3) == axis, np.sign(gravity[axis]) * 9.81, 0.0)


class EffortRows:
    """The rows of a measurement that count: effort and what the motion can make of it, after the low pass."""

    def __init__(self, measured: Measurement, robot: Robot) -> None:
        """Compute the URDF's torques at `_ROWS` rows at most, linear between."""
        self.measured, motion = measured, measured.motion
        every = max(1, motion.samples // _ROWS)
        thin = motion[slice(None, None, every)]
        still = np.zeros_like(thin.q)
        nothing = robot.rigid.inverse_dynamics(replace(thin, dq=still, ddq=still, gravity=(0.0, 0.0, 0.0)))
        axes: list[tuple[float, float, float]] = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
        at_rest = [replace(thin, dq=still, ddq=still, gravity=axis) for axis in axes]
        weight = [robot.rigid.inverse_dynamics(one) - nothing for one in at_rest]
        self.robot = robot
        self.gravity = np.array(motion.gravity or robot.rigid.model.gravity.linear, dtype=float)
        inertial = robot.rigid.inverse_dynamics(thin) - sum(g * w for g, w in zip(self.gravity, weight, strict=True))
        *weight, inertial = (at_all_rows(one, motion.samples, every) for one in (*weight, inertial))
        self.weight = measured.passed(np.stack(weight, axis=2))  # [N, n, 3] Nm per m/s^2
        self.tau = measured.passed(measured.torque + beyond_base(motion, robot))
        parts = (inertial, motion.dq, np.sign(motion.dq), motion.ddq, np.ones_like(motion.q))
        self.drive = measured.passed(np.stack(parts, axis=2))  # [N, n, 5]
        self.used = measured.used[measured.rows]
        self.spacing = measured.dt * measured.decimate
        self.block = rows_in_block(measured)
        enough = self.used.sum(axis=0) > 5 * self.drive.shape[2]
        self.moving = np.flatnonzero((np.ptp(motion.q, axis=0) > _MOVES) & enough).tolist()

    def of(self, joint: int, effort: int | None = None) -> tuple[Array, Array]:
        """Return the columns of a joint [K, 6], weight first and offset last, and its own or another's effort [K]."""
        effort = joint if effort is None else effort
        used = self.used[:, effort]
        return self.columns(joint)[used], self.tau[used, effort]

    def columns(self, joint: int) -> Array:
        """Return the columns of a joint [K, 6] at all rows, those that don't count included."""
        return np.column_stack([self.weight[:, joint] @ self.gravity, self.drive[:, joint]])

    @property
    def efforts(self) -> list[Array]:
        """The efforts [K, n] of all rows: of every period by itself where there are some, else of the recording."""
        periods = self.measured.period_torque
        if periods is None:
            return [self.tau]
        mean = self.measured.torque
        whole = (np.where(np.isfinite(one), one, mean) for one in periods)
        return [self.tau + self.measured.passed(one - mean) for one in whole]


def _unsigned_joints(rows: EffortRows) -> list[int]:
    """Return the joints whose effort has lost its sign.

    It never changes, and fits the motion far better where the motion's torque says when it turns. Beside one such
    joint, or another of its kind, it is enough that an effort falls to zero and never below it although weight and
    inertia of the URDF turn: a driver treats its joints alike.
    """
    never_turns = [joint for joint in rows.moving if one_sided(rows.of(joint)[1])]
    sure = [joint for joint in never_turns if _fits_better(*rows.of(joint))]
    alike = [joint for joint in never_turns if joint in sure or _folded(*rows.of(joint))]
    return alike if sure or len(alike) > 1 else []


def _in_words(joints: Sequence[str], *, all_moving: bool) -> str:
    """Return in a sentence which joints' efforts have no sign and what to do."""
    listed = ", ".join(joints)
    which = f"all {len(joints)} joints that move ({listed})" if all_moving and len(joints) > 1 else listed
    return (
        f"the effort of {which} never changes its sign although the motion's torque does: the driver reports absolute"
        " values; record effort with its sign, or write effort: {unsigned: true} in the robot YAML: its sign is then"
        " taken from the motion"
    )


def _left_over(columns: Array, tau: Array) -> float:
    """Return the power of an effort [K] that columns [K, k] leave."""
    return float(np.sum((tau - columns @ np.linalg.lstsq(columns, tau, rcond=1e-9)[0]) ** 2))


def _fits_better(columns: Array, tau: Array) -> bool:
    """Return whether the motion explains an effort that turns, and not the one-sided one."""
    made, left = folded_back(columns, np.abs(tau))
    after, power = float(left @ left), float(np.sum(tau**2))
    turned = min(np.mean(made > 0), np.mean(made < 0))
    return bool(turned > _TURNED and after < _BETTER * _left_over(columns, tau) and after < (1.0 - EXPLAINED) * power)


def _folded(columns: Array, tau: Array) -> bool:
    """Return whether an effort falls to zero and turns back there, although the URDF's torque goes on."""
    urdf = columns[:, 0] + columns[:, 1]
    turns = min(np.mean(urdf > 0), np.mean(urdf < 0)) > _TURNED
    size = np.abs(tau)
    return bool(turns and np.quantile(size, 0.02) < _TOUCHES * size.max() < np.quantile(size, 0.5))


def _out_of_step(rows: EffortRows) -> list[str]:
    """Say that efforts are of another time than positions: shifted by one time, all of them fit the motion better.

    A shift by s leaves 1 - |Q_j' tau_j(t + s)|^2 / |tau_j|^2 of joint j, Q_j an orthonormal basis of what its motion
    can make of an effort; the least of the mean over the joints within a quarter of a second is held against the least
    beyond it, round a period or the recording.
    """
    bases = []  # their spectra
    for joint in rows.moving:
        columns = rows.columns(joint)
        size = np.linalg.norm(columns, axis=0)
        seen = size > 1e-9 * size.max()
        bases.append(np.fft.rfft(np.linalg.qr(columns[:, seen] / size[seen])[0], axis=0))
    near = max(1, round(_CLOSE / rows.spacing))
    found = []
    for number, efforts in enumerate(rows.efforts if bases else (), start=1):
        left = []
        for basis, tau in zip(bases, efforts[:, rows.moving].T, strict=True):
            about = tau - tau.mean()
            products = np.fft.irfft(np.conj(basis) * np.fft.rfft(about)[:, None], len(tau), axis=0)
            left.append(1.0 - np.sum(products**2, axis=1) / max(float(about @ about), 1e-300))
        total = np.mean(left, axis=0)
        if len(total) < 3 * near:
            return []
        steps = np.arange(len(total))
        close = np.minimum(steps, len(total) - steps) < near
        best, here = int(np.argmin(np.where(close, np.inf, total))), float(total[close].min())
        shift = (best if best <= len(total) // 2 else best - len(total)) * rows.spacing
        found.append((float(total[best] / here), number, here, total[best], -shift))
    ratio, number, here, there, shift = min(found, default=(1.0, 0, 0.0, 0.0, 0.0))
    if ratio > _CLEARLY:
        return []
    which = f" in period {number}" if len(found) > 1 else ""
    return [
        f"the efforts{which} are not of the same time as the positions: the motion leaves {100 * here:.2g} % of their"
        f" power, {100 * there:.2g} % where they are shifted by {shift:+.3g} s (efforts of another run, samples lost,"
        " or clocks apart); record motion and effort together"
    ]


def paces_apart(rows: Sequence[EffortRows], judged: Sequence[Sequence[Declared]]) -> str:
    """Return which two recordings' clocks run at different paces, in a sentence; or nothing.

    rows, judged: by recording what its efforts are, and by joint the shares of the URDF's weight and inertia that they
    hold. Their ratios don't know the URDF's masses. What changes inertia otherwise, a mass that sloshes, no pace of the
    clock explains.
    """
    for (first, before), (second, after) in combinations(zip(rows, judged, strict=True), 2):
        ratios = [
            Declared(
                a.joint, a.share, a.std, "consistent", "", b.gravity / a.gravity, b.inertia / a.inertia, 0.0, least
            )
            for a, b in zip(before, after, strict=True)
            if (least := min(a.explained, b.explained)) and a.gravity and a.inertia
        ]
        told = [one for one in by_clock(ratios) if one.verdict == "clock"]
        factor = float(np.median([one.inertia for one in told])) if told else 1.0
        if told and _by_pace(first, second, factor**0.5) > _OF_CLOCK:
            pace = factor**0.5 if factor > 1.0 else factor**-0.5
            ordered = (second, first) if factor > 1.0 else (first, second)
            fast, slow = (one.measured.source for one in ordered)
            return (
                f"{fast} and {slow} contradict each other: weight is alike and inertia"
                f" {max(factor, 1 / factor):.3g} times as large on every joint, so that the stamps of {fast} run"
                f" {pace:.3g} times as fast as those of {slow}; record anew, or put the times right"
            )
    return ""


def _by_pace(first: EffortRows, second: EffortRows, pace: float) -> float:
    """Return the share that a clock's pace explains of what one inertia, damping and rotor leave of two recordings'
    efforts beyond own ones for each, every joint's power counted alike: the second's speed goes with the pace, its
    acceleration and inertial torque with the square. Weight, dry friction and offset know no time.
    """
    apart = together = paced = 0.0
    for joint in set(first.moving) & set(second.moving):
        (one, tau), (other, efforts) = first.of(joint), second.of(joint)
        both = np.concatenate([tau, efforts])
        power = max(float(np.sum((both - both.mean()) ** 2)), 1e-300)
        own = np.block([[one[:, _TIMELESS], 0.0 * one[:, _TIMELESS]], [0.0 * other[:, _TIMELESS], other[:, _TIMELESS]]])
        apart += (_left_over(one, tau) + _left_over(other, efforts)) / power
        timed = (np.vstack([one[:, _TIMED], other[:, _TIMED] * scale]) for scale in (1.0, pace ** np.array([2, 1, 2])))
        same, scaled = (_left_over(np.hstack([own, columns]), both) / power for columns in timed)
        together, paced = together + same, paced + scaled
    return (together - paced) / max(together - apart, 1e-300)
