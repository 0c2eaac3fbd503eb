"""Springs, gaps, loads and couplings of the simulated robot."""

from __future__ import annotations

from typing import Any, Self

import casadi as ca
import numpy as np

from robot_ident.errors import InputError
from robot_ident.robot.robot import Robot, Spring
from robot_ident.robot.symbolic import frame_function, placements_function
from robot_ident.signals.motion import Motion
from robot_ident.testbed.links import links, links_torque
from robot_ident.testbed.phenomena.friction import Bristles, MaxwellSlip
from robot_ident.testbed.phenomena.phenomenon import (
    Contribution,
    Instant,
    Physics,
    Value,
    arm_mass,
    between,
    damping,
    dry_friction,
    either_sign,
    home_inertia,
    log_even,
    neighbour,
    strength,
    times,
)


def _stiff(robot: Robot, joint: int) -> float:
    """Return a stiffness [Nm/rad] that the joint's torque twists by 2 mrad."""
    return strength(robot, joint) / 0.002


class Backlash(Physics):
    """Play between motor and link: neither feels the other until the gap is crossed, then they meet in a stiff contact.

    The shaft carries k (c + (|c|^2 + e^2)^(1/2) of both flanks) beyond +- gap / 2, with e a twentieth of the gap, and
    damping in contact alone.
    """

    name = "backlash"
    parameters = (
        Value("gap", "rad", "m", lower=1e-6, usual=0.001, drawn=log_even(5e-4, 1.5e-3)),
        Value("stiffness", "Nm/rad", "N/m", lower=1.0, usual=_stiff),
        Value("damping", "Nm s/rad", "N s/m", lower=0.0, usual=times(2e-3, _stiff)),
    )
    largest = 3.0
    smallest = 0.6
    shaft = True
    step_rate = 4500.0

    def transmit(self, twist: Any, rate: Any) -> tuple[Any, Any, Any]:
        """Return the contact's torque, slope and damping."""
        half = self.values["gap"] / 2
        edge = half / 10
        above, below = ca.sqrt((twist - half) ** 2 + edge**2), ca.sqrt((twist + half) ** 2 + edge**2)
        pressed = twist + (above - below) / 2
        contact = 1 + ((twist - half) / above - (twist + half) / below) / 2
        k, d = self.values["stiffness"] * contact, self.values["damping"] * contact
        return self.values["stiffness"] * pressed + d * rate, k, d


class JointElasticity(Physics):
    """A shaft of stiffness k and damping d between motor and link: two masses, of which the encoder sees the motor.

    The motor has the armature of the robot's description, or a fifth of what the joint feels where that is unknown; the
    link has the rest (Spong 1987).
    """

    name = "joint_elasticity"
    parameters = (
        Value("stiffness", "Nm/rad", "N/m", lower=1.0, usual=_stiff),
        Value("damping", "Nm s/rad", "N s/m", lower=0.0, usual=times(1e-3, _stiff)),
    )
    largest = 4.0
    shaft = True

    def scaled(self, factor: float) -> Self:
        """Return it softer by a factor."""
        softer = {key: self.values[key] / factor for key in ("stiffness", "damping")}
        return type(self)(self.robot, self.place, softer)

    def transmit(self, twist: Any, rate: Any) -> tuple[Any, Any, Any]:
        """Return k twist + d rate, k and d."""
        k, d = self.values["stiffness"], self.values["damping"]
        return k * twist + d * rate, k, d


EDGE = 0.004
"""Speed [rad/s] over which the shaft's friction changes its direction: its seals give a little; distance [rad] over
which a bumper is met: rubber isn't flat."""


class JointCoupling(Physics):
    """Friction that the shaft of another joint leaves in this one: c (2 / pi) atan(dq_o / e) + b dq_o, and its inertia.

    other: number of the other joint, from 1. c [Nm], b [Nm s/rad]. inertia [kg m^2] couples both ways.
    """

    name = "joint_coupling"
    needs = "another joint"
    parameters = (
        Value("coulomb", "Nm", "N", usual=times(0.2, dry_friction)),
        Value("viscous", "Nm s/rad", "N s/m", usual=times(0.1, damping)),
        Value("inertia", "kg m^2", "kg"),
        Value("other", "1", "1", lower=1, structural=True, usual=neighbour),
    )
    largest = 3.0
    sizes = ("coulomb", "viscous")

    def __init__(self, robot: Robot, joint: int | None, values: dict[str, float]) -> None:
        """Place it; the other joint must be another one of this robot."""
        other = values.get("other")
        if other is not None and (other not in range(1, robot.n + 1) or other == (joint or 0) + 1):
            raise InputError(
                f"{self.name}@{robot.joints[joint or 0]}: other = {other:g}; the number of another joint, from 1 to"
                f" {robot.n}, is needed"
            )
        super().__init__(robot, joint, values)

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return dry and viscous friction in any proportion, of any other joint."""
        usual, share = cls.typical(robot, joint), rng.uniform(0.2, 1.0)
        other = rng.choice([k + 1 for k in range(robot.n) if k != joint])
        return usual | {
            "coulomb": usual["coulomb"] * share,
            "viscous": usual["viscous"] * (1.2 - share),
            "other": float(other),
        }

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque at this joint."""
        other = int(self.values["other"]) - 1
        v = x.v[other]
        torque = self.values["coulomb"] * 2 / np.pi * ca.atan(v / EDGE) + self.values["viscous"] * v
        inertia = {(self.joint, other): self.values["inertia"], (other, self.joint): self.values["inertia"]}
        return Contribution(torque={self.joint: torque}, inertia=inertia)


USUAL = Spring(0.488, 0.1)
"""A spring whose geometry is unknown is taken to be like that of the KUKA IR 361 [m]."""


class GravitySpring(Physics):
    """A spring of stiffness k and free length l0 between a fixed point at distance L from the axis and a lever r on the
    link.

    The spring's force is k (d - l0) at length d(q) = sqrt(L^2 + r^2 - 2 L r cos q), its arm L r sin(q) / d: the drive
    carries L r sin(q) (k - k l0 / d(q)), the derivative of the energy k (d - l0)^2 / 2. L (`length`) and r (`lever`)
    are the robot's where its description gives them.
    """

    name = "gravity_spring"
    parameters = (
        Value("stiffness", "N/m", "N/m", lower=0.0),
        Value("free_length", "m", "m", lower=0.0),
        Value("length", "m", "m", lower=1e-3),
        Value("lever", "m", "m", lower=1e-3),
    )
    side = "link"
    loads_gear = True

    @classmethod
    def known(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return length and lever of the robot's spring at a joint, or usual ones."""
        spring = robot.springs.get(robot.joints[joint], USUAL)
        return {"length": spring.length, "lever": spring.lever}

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return a spring that is slack at its shortest and gives the joint's torque when stretched to the side."""
        spring = robot.springs.get(robot.joints[joint], USUAL)
        slack = abs(spring.length - spring.lever)
        side = (spring.length**2 + spring.lever**2) ** 0.5
        arm = spring.length * spring.lever / side
        stiffness = strength(robot, joint) / max(arm * (side - slack), 1e-9)
        return {"stiffness": stiffness, "free_length": slack, **cls.known(robot, joint)}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return another geometry where the robot has none, the spring slack at its shortest."""
        if robot.joints[joint] in robot.springs:
            return cls.typical(robot, joint)
        length = rng.uniform(0.35, 0.6)
        lever = length * rng.uniform(0.15, 0.35)
        stiffness = strength(robot, joint) / (length * lever)
        return {"stiffness": stiffness, "free_length": length - lever, "length": length, "lever": lever}

    @classmethod
    def possible(cls, robot: Robot, joint: int) -> bool:
        """Return whether the joint turns under a weight: elsewhere nobody needs one."""
        import pinocchio

        model = robot.rigid.model
        data, rng = model.createData(), np.random.default_rng(0)
        poses = rng.uniform(-1.0, 1.0, (5, robot.n))
        weight = max(abs(float(pinocchio.computeGeneralizedGravity(model, data, q)[joint])) for q in poses)
        return not robot.prismatic[joint] and weight > 1e-6

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque that the drive carries."""
        k, rest = self.values["stiffness"], self.values["free_length"]
        big, small, q = self.values["length"], self.values["lever"], x.q[self.joint]
        length = ca.sqrt(big**2 + small**2 - 2 * big * small * ca.cos(q))
        return Contribution(torque={self.joint: k * (length - rest) * (big * small * ca.sin(q) / length)})


SPREAD = (0.4, 1.0, 1.8)


class Cable(Bristles):
    """A hose package bent along a joint: k (q - q0) (1 + hardening (q - q0)^2), and rubbing strands.

    k [Nm/rad], q0 [rad] where it is relaxed, hardening [1/rad^2]; the strands are Maxwell elements of level `rubbing`
    [Nm] that slip after about `reach` [rad].
    """

    name = "cable"
    includes = ("torque_offset",)
    parameters = (
        Value("cable", "Nm/rad", "N/m", usual=times(0.02, strength)),
        Value("relaxed", "rad", "m"),
        Value("hardening", "1/rad^2", "1/m^2", lower=0.0, usual=0.1),
        Value("rubbing", "Nm", "N", lower=0.0, usual=times(0.06, times(0.02, strength))),
        Value("reach", "rad", "m", lower=1e-4, usual=0.1),
    )
    states = len(SPREAD)
    side = "link"
    largest = 3.0
    sizes = ("cable", "rubbing")
    loads_gear = True

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return a cable relaxed somewhere in the middle, with up to .15 of hardening and of rubbing."""
        usual, middle = cls.typical(robot, joint), float(np.mean(motion.q[:, joint]))
        return usual | {
            "relaxed": middle + rng.uniform(-0.5, 0.5),
            "hardening": rng.uniform(0.0, 0.15),
            "rubbing": usual["cable"] * rng.uniform(0.0, 0.08),
            "reach": rng.uniform(0.05, 0.2),
        }

    def elements(self) -> MaxwellSlip:
        """Return the strands."""
        return MaxwellSlip(self.values["rubbing"], [self.values["reach"] * share for share in SPREAD])

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque that bends the cable."""
        bent = x.q[self.joint] - self.values["relaxed"]
        spring = self.values["cable"] * bent * (1 + self.values["hardening"] * bent**2)
        strands = self.elements()
        rub = strands.force(strands.stretched(x.state, x.moved[self.joint]))
        return Contribution(torque={self.joint: spring + rub})


def _before_the_limit(robot: Robot, joint: int) -> float:
    upper = float(robot.limits.upper[joint])
    return 0.8 * upper if np.isfinite(upper) else 1.0


class EndStop(Physics):
    """A rubber bumper beyond `position` [rad], in the direction +1 or -1: k p (1 + p / p0), p how far it is pressed in.

    k [Nm/rad], p0 = .6 rad: rubber stiffens.
    """

    name = "end_stop"
    parameters = (
        Value("end_stop", "Nm/rad", "N/m", lower=0.0, usual=times(0.15, strength)),
        Value("position", "rad", "m", usual=_before_the_limit),
        Value("direction", "1", "1", -1.0, 1.0, usual=1.0),
    )
    side = "link"
    largest = 2.0
    loads_gear = True

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return a bumper that the motion presses in for a twentieth to a fifth of the time."""
        direction = either_sign(rng)
        position = float(np.quantile(direction * motion.q[:, joint], 1 - rng.uniform(0.05, 0.2)))
        return cls.typical(robot, joint) | {"position": direction * position, "direction": direction}

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque that presses it in."""
        direction = self.values["direction"]
        beyond = direction * (x.q[self.joint] - self.values["position"])
        pressed = (beyond + ca.sqrt(beyond**2 + EDGE**2)) / 2
        return Contribution(torque={self.joint: direction * self.values["end_stop"] * pressed * (1 + pressed / 0.6)})


class BaseTilt(Physics):
    """The floor is turned by `tilt_x`, then `tilt_y` [rad], about the base's own axes: gravity comes from elsewhere.

    Gravity torque is linear in the vector g, exactly: what is added is that of the change of g.
    """

    name = "base_tilt"
    parameters = (
        Value("tilt_x", "rad", "rad", -1.5, 1.5, usual=0.02),
        Value("tilt_y", "rad", "rad", -1.5, 1.5, usual=0.02),
    )
    scope = "robot"
    side = "link"
    sizes = ("tilt_x", "tilt_y")
    largest = 3.0
    loads_gear = True

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return a tilt of 2 to 3 % in any direction."""
        angle, size = rng.uniform(-np.pi, np.pi), between(rng, 0.02, 0.03)
        return {"tilt_x": size * float(np.cos(angle)), "tilt_y": size * float(np.sin(angle))}

    def contribution(self, x: Instant) -> Contribution:
        """Return the change of the gravity torque."""
        g = np.array(self.robot.rigid.model.gravity.linear)
        about_x, about_y = self.values["tilt_x"], self.values["tilt_y"]
        # g in the turned base: R_y^T R_x^T g.
        y = ca.cos(about_x) * g[1] + ca.sin(about_x) * g[2]
        z = -ca.sin(about_x) * g[1] + ca.cos(about_x) * g[2]
        turned = (ca.cos(about_y) * g[0] - ca.sin(about_y) * z, y, ca.sin(about_y) * g[0] + ca.cos(about_y) * z)
        still = ca.SX(self.robot.n, 1)
        change = ca.vertcat(*turned) - g
        torque = links_torque(self.robot, ca.vertcat(*x.q), still, still, change, self.robot.rigid.parameters)
        return Contribution(torque=dict(enumerate(ca.vertsplit(torque))))


class ExternalForce(Physics):
    """An elastic hose from a post at (x, y, z) [m] beside the base to the end of a link, slack below its free length.

    At length d it stores k max(0, d - l0)^2 / 2; the drives carry the derivative of that energy by every joint. The end
    is where the next joint sits, on the last link the end effector.
    """

    name = "external_force"
    parameters = (
        Value("stiffness", "N/m", "N/m", lower=0.0),
        Value("free_length", "m", "m", lower=0.0),
        *(Value(axis, "m", "m") for axis in ("x", "y", "z")),
    )
    side = "link"
    largest = 3.0
    loads_gear = True

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return a hose from a post beside the base that pulls with a twentieth of the joint's torque at arm's
        length.
        """
        reach = cls._reach(robot)
        return {
            "stiffness": 0.05 * strength(robot, joint) / reach**2,
            "free_length": 0.2 * reach,
            "x": 0.0,
            "y": 0.4 * reach,
            "z": 0.5 * reach,
        }

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return one from a post anywhere around, above or beside the base."""
        angle, reach = rng.uniform(-np.pi, np.pi), cls._reach(robot)
        away = reach * rng.uniform(0.2, 0.8)
        return cls.typical(robot, joint) | {
            "free_length": reach * rng.uniform(0.0, 0.5),
            "x": away * float(np.cos(angle)),
            "y": away * float(np.sin(angle)),
            "z": reach * rng.uniform(0.1, 1.0),
        }

    @classmethod
    def possible(cls, robot: Robot, joint: int) -> bool:
        """Return whether the link's end moves with more than one joint, and stays on the link."""
        return joint > 0 and (joint + 1 == robot.n or not robot.prismatic[joint + 1])

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque against its pull."""
        q = ca.SX.sym("q", self.robot.n)
        if self.joint + 1 < self.robot.n:
            end = placements_function(self.robot)(q)[1][:, self.joint + 1]
        else:
            end = frame_function(self.robot, self.robot.end_effector)(q)
        away = end - ca.vertcat(*(self.values[axis] for axis in ("x", "y", "z")))
        stretch = ca.fmax(ca.norm_2(away) - self.values["free_length"], 0.0)
        torque = ca.gradient(0.5 * self.values["stiffness"] * stretch**2, q)
        here = ca.substitute(torque, q, ca.vertcat(*x.q))
        return Contribution(torque=dict(enumerate(ca.vertsplit(here))))

    @staticmethod
    def _reach(robot: Robot) -> float:
        """Return how far the arm reaches from joint to joint [m]."""
        placements = list(robot.rigid.model.jointPlacements)[2:]
        return max(float(sum(np.linalg.norm(one.translation) for one in placements)), 0.1)


class Payload(Physics):
    """A point mass m at (x, y, z) [m] in the frame of the end effector.

    It changes all the arm's equations: torque is linear in the inertial parameters of the last link, to which m, m p
    and m (p^2 I - p p^T) are added.
    """

    name = "payload"
    parameters = (
        Value("payload", "kg", "kg", lower=0.0, usual=lambda robot, _: arm_mass(robot) / 40),
        *(Value(axis, "m", "m") for axis in ("x", "y", "z")),
    )
    scope = "robot"
    side = "link"
    loads_gear = True

    def contribution(self, x: Instant) -> Contribution:
        """Return inertia and torque of the mass."""
        n, model = self.robot.n, self.robot.rigid.model
        frame = model.frames[model.getFrameId(self.robot.end_effector)]
        rotation, origin = ca.DM(np.array(frame.placement.rotation)), ca.DM(np.array(frame.placement.translation))
        p = origin + ca.mtimes(rotation, ca.vertcat(*(self.values[axis] for axis in ("x", "y", "z"))))
        m = self.values["payload"]
        moment = m * (ca.dot(p, p) * ca.SX.eye(3) - ca.mtimes(p, p.T))
        entries = [moment[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
        added, last = ca.SX(10 * n, 1), 10 * (frame.parentJoint - 1)
        added[last : last + 10] = ca.vertcat(m, m * p, *entries)
        mass, bias = links(self.robot, ca.vertcat(*x.q), ca.vertcat(*x.v), added)
        inertia = {(i, j): mass[i, j] for i in range(n) for j in range(n)}
        return Contribution(torque=dict(enumerate(ca.vertsplit(bias))), inertia=inertia)


def _rotor(robot: Robot, joint: int) -> float:
    """Return the armature and a quarter of the joint's inertia [kg m^2]."""
    return float(robot.drives.armature[joint]) + 0.25 * float(home_inertia(robot)[joint])


class RotorInertia(Physics):
    """Inertia Ia of the rotor on the joint side, in place of the armature that the robot's description gives."""

    name = "rotor_inertia"
    parameters = (Value("rotor_inertia", "kg m^2", "kg", lower=0.0, usual=_rotor),)
    largest = 2.5

    @classmethod
    def possible(cls, robot: Robot, joint: int) -> bool:
        """Return whether it has a column of its own: elsewhere it merges with rigid-body parameters."""
        from robot_ident.model.base_parameters import reduce_to_base

        return joint in reduce_to_base(robot).free_rotors

    def scaled(self, factor: float) -> Self:
        """Return it with the part beyond the armature multiplied."""
        armature = float(self.robot.drives.armature[self.joint])
        beyond = armature + factor * (self.values["rotor_inertia"] - armature)
        return type(self)(self.robot, self.place, {"rotor_inertia": beyond})

    def contribution(self, x: Instant) -> Contribution:
        """Return the inertia beyond the armature, which M(q) has already."""
        beyond = self.values["rotor_inertia"] - float(self.robot.drives.armature[self.joint])
        return Contribution(inertia={(self.joint, self.joint): beyond})
