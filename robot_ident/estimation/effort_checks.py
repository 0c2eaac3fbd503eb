"""Is the effort that of this arm in this motion, as its YAML declares it? Noise, absolute values, another joint's
effort, another gravity; `contradictions` asks all of it.

Each joint's effort is held against what its motion can make of it,

    tau_j = s_j I_j(q, dq, ddq) + G_j(q) + b dq_j + c sign(dq_j) + o + r ddq_j,

I_j the URDF's inertial torque and G_j that of its weight: `gravity` tries every gravity in G, `foreign` every sign of
tau, `exchanged` every joint's right-hand side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.contradiction import Contradiction, contradiction, coupling_contradiction
from robot_ident.estimation.declaration import clustered, judge_all, judge_measured, scale_notes
from robot_ident.estimation.effort_rows import EffortRows, clocks_apart, in_words, out_of_step, unsigned_joints
from robot_ident.recording.conditions import sidecar
from robot_ident.recording.measurement import Measurement
from robot_ident.recording.payload_torque import with_payload
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
    found = (
        coupling_contradiction(measurements, robot)
        or checks.gravity()
        or contradiction(judge_all(measurements, robot), robot)
    )
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
        return clocks_apart([rows for _, rows in told], [judge_measured(m, self._robot) for m, _ in told])

    def exchanged(self) -> str:
        """Return which joints' efforts follow each other's motion, in a sentence; or nothing."""
        return "" if self._robot.effort.coupling is not None else self._first(_exchanged)

    def _first(self, look: Callable[[EffortRows], list[str]]) -> str:
        """Return what a look at the recordings says of the first one of which it says something."""
        told = ((measured.source, look(rows)) for measured, rows in self._measured)
        return next((f"{source}: {'; '.join(words)}" for source, words in told if words), "")

    def gravity(self) -> Contradiction | None:
        """Return what the efforts say of gravity where that is far from what is declared, by the robot YAML or a
        recording's conditions, or None.

        g [3] m/s^2 is fitted to all joints at once, tau_j = s_j I_j + sum_k g_k G_jk + ... Only what two joints or
        more tell counts, and only where one gravity explains their efforts as well as a share of the declared weight
        by joint does: a counterbalance on one of them is no other gravity. An unknown payload tells nothing.
        """
        if any(self._robot.effort.of(joint).gravity == "removed" for joint in self._robot.joints):
            return None
        for measured, rows in self._measured:
            found = None if measured.conditions.estimated else _gravity(rows)
            if found is not None:
                stated = measured.conditions.gravity is not None
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
    lost, names = unsigned_joints(rows), rows.robot.joints
    nothing = []
    for joint in rows.moving:
        explained, seen = _explained(*rows.of(joint), rows.block)
        if joint not in lost and explained < _NOTHING and seen < _SEEN:
            nothing.append(f"{names[joint]} ({100 * max(explained, 0.0):.1f} %)")
    noise = [
        f"the effort of {', '.join(nothing)} is not made by the motion (noise, or that of another run): weight, inertia"
        " and friction explain no more of it than chance does; record motion and effort together"
    ]
    noise = noise if nothing else []
    if lost:
        return [*noise, in_words([names[joint] for joint in lost], all_moving=len(lost) == len(rows.moving))]
    return out_of_step(rows) or noise


def _explained(columns: Array, tau: Array, block: int) -> tuple[float, float]:
    """Return the share of an effort's power about its mean that columns explain, the last one its offset, and by how
    many standard deviations the surest of them is seen.
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

    def left_by_share(self, gravity: Array) -> float:
        """Return what the best share of a gravity leaves of the effort."""
        own = self.weight @ gravity
        return self.left(gravity * float(own @ self.tau) / max(float(own @ own), 1e-300))


def _gravity(rows: EffortRows) -> Contradiction | None:
    loaded = [one for joint in rows.moving if (one := _loaded(rows, joint)) is not None]
    if len(loaded) < 2 or not all(one.sound for one in loaded):
        return None
    weight, tau = np.vstack([one.weight for one in loaded]), np.concatenate([one.tau for one in loaded])
    inverse = np.linalg.pinv(weight.T @ weight)
    found = inverse @ weight.T @ tau
    pieces = []
    for one in loaded:
        if one.left(found) > _AS_WELL * one.left_by_share(rows.gravity) + _ALSO * float(one.tau @ one.tau):
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
