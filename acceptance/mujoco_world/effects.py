"""What the arms hide, by MuJoCo's own elements: springs, plastic springs, tendons, LuGre motors, cogging, contacts.

Each is drawn first (which form, where), then built into a spec at a size. KNOWN ones the catalogue has a name for,
UNKNOWN ones act on several joints and stand in no catalogue.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import mujoco
import numpy as np

from mujoco_world.arm import STEP, Arm, Array, effort_sensor

GEAR = 101
"""Motor turns a joint turn."""


@dataclass(frozen=True)
class Draw:
    """Chance, the arm, the joint, and what the joints' positions reach [n, 2] on the training motions."""

    rng: np.random.Generator
    arm: Arm
    joint: int
    reach: Array

    def between(self, low: float, high: float) -> float:
        """Return a number between two, evenly in its logarithm."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def choose(self, *names: str) -> str:
        return str(self.rng.choice(names))

    @property
    def name(self) -> str:
        return self.arm.joints[self.joint]


class Build(Protocol):
    """Puts something hidden of a size into a spec."""

    def __call__(self, spec: Any, size: float) -> None: ...


@dataclass(frozen=True)
class Place:
    """Where joint, parent body and link stand at the zero pose, in the world's frame."""

    anchor: Array
    axis: Array
    parent: Any
    link: Any

    def site(self, spec: Any, *, on_link: bool, at: Array, name: str) -> str:
        """Add a site to the link or to what carries it, at a point of the world; return its name."""
        view = self.link if on_link else self.parent
        body = spec.body(view.name)
        local = np.array(view.xmat).reshape(3, 3).T @ (at - np.array(view.xpos))
        body.add_site(name=name, pos=local)
        return name


def place(arm: Arm, joint: int) -> Place:
    model = arm.healthy
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    number = model.joint(arm.joints[joint]).id
    body = model.jnt_bodyid[number]
    return Place(
        np.array(data.xanchor[number]),
        np.array(data.xaxis[number]),
        data.body(model.body_parentid[body]),
        data.body(body),
    )


def motor(spec: Any, joint: str, *, lugre: Any = None, cogging: Any = None) -> None:
    """Add a motor without windings to a joint: its bristles or its magnets alone."""
    actuator = spec.add_actuator(name=f"passive_{len(spec.actuators)}", target=joint)
    actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
    actuator.set_to_dcmotor(
        motorconst=[0.0, 0.0],
        resistance=1.0,
        lugre=[0.0] * 5 if lugre is None else lugre,
        cogging=[0.0] * 3 if cogging is None else cogging,
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE),
    )


def tendon_of(spec: Any, joint: str, **settings: Any) -> None:
    """Add a tendon that is as long as a joint's position says."""
    tendon = spec.add_tendon(name=f"tendon_{len(spec.tendons)}")
    tendon.wrap_joint(joint, 1.0)
    for key, value in settings.items():
        setattr(tendon, key, value)


def cable(d: Draw) -> Build:
    """A spring of the joint, at rest somewhere in its range."""
    rest = d.rng.uniform(*d.reach[d.joint])

    def build(spec: Any, size: float) -> None:
        joint = spec.joint(d.name)
        joint.stiffness, joint.springref = [5.0 * size, 0.0, 0.0], rest

    return build


def gravity_spring(d: Draw) -> Build:
    """A tendon from a post above the joint to a lever on the link, which is taut beyond its length."""
    there = place(d.arm, d.joint)
    nearer = place(d.arm, d.joint + 1).anchor - there.anchor
    up, along = (v - there.axis * (v @ there.axis) for v in (np.array([0.0, 0.0, 1.0]), nearer))
    height, ratio = d.between(0.2, 0.5), d.between(0.15, 0.6)
    post = there.anchor + height * up / np.linalg.norm(up)
    end = there.anchor + height * ratio * along / np.linalg.norm(along)
    rest = d.rng.uniform(0.0, 0.8) * height * (1.0 - ratio)

    def build(spec: Any, size: float) -> None:
        tendon = spec.add_tendon(name="balancer", stiffness=[1000.0 * size, 0.0, 0.0], springlength=[0.0, rest])
        tendon.wrap_site(there.site(spec, on_link=False, at=post, name="post"))
        tendon.wrap_site(there.site(spec, on_link=True, at=end, name="lever"))

    return build


def end_stop(d: Draw) -> Build:
    """A buffer near one end of what the joint travels: a tendon that is taut beyond, or a soft limit."""
    low, high = d.reach[d.joint]
    depth, form, upper = d.rng.uniform(0.1, 0.25) * (high - low), d.choose("tendon", "limit"), d.rng.random() < 0.5
    free = [low - 10.0, high - depth] if upper else [low + depth, high + 10.0]

    def build(spec: Any, size: float) -> None:
        if form == "tendon":
            tendon_of(spec, d.name, stiffness=[20.0 * size, 0.0, 0.0], springlength=free)
            return
        joint = spec.joint(d.name)
        joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, free
        joint.solref_limit, joint.solimp_limit = [-60.0 * size, -1.0], [0.5, 0.5, 0.001, 0.5, 2.0]

    return build


def viscous_nonlinear(d: Draw) -> Build:
    """Damping of the second or the third power of speed."""
    form = d.choose("square", "cube")

    def build(spec: Any, size: float) -> None:
        joint = spec.joint(d.name)
        own = joint.damping[0]
        joint.damping = [own, 3.0 * size, 0.0] if form == "square" else [own, 0.0, 3.0 * size]

    return build


def stribeck(d: Draw) -> Build:
    """LuGre's bristles in place of the joint's dry friction, stiff, stronger near rest."""
    slow, coulomb = d.between(0.02, 0.15), float(d.arm.coulomb[d.joint])

    def build(spec: Any, size: float) -> None:
        spec.joint(d.name).frictionloss = 0.0
        motor(spec, d.name, lugre=[coulomb / 2e-5, 0.0, coulomb, coulomb * (1.0 + 0.5 * size), slow])

    return build


def presliding(d: Draw) -> Build:
    """The joint's dry friction by soft bristles, or by plastic springs side by side."""
    coulomb, form = float(d.arm.coulomb[d.joint]), d.choose("bristles", "springs")
    shares = np.sort(d.rng.dirichlet(np.full(4, 3.0)))

    def build(spec: Any, size: float) -> None:
        reach = 0.01 * size
        spec.joint(d.name).frictionloss = 0.0
        if form == "bristles":
            motor(spec, d.name, lugre=[coulomb / reach, 0.0, coulomb, coulomb, 0.1])
            return
        for share, way in zip(shares, reach * np.array([0.3, 0.7, 1.3, 2.5]), strict=True):
            tendon_of(
                spec, d.name, stiffness=[share * coulomb / way, 0.0, 0.0], springlength=[0.0, 0.0], springyield=way
            )

    return build


def friction_behind_play(d: Draw) -> Build:
    """A ring about the axis that rubs on what carries the joint, and that the link drags through a clearance."""
    gap = d.between(0.005, 0.05)

    def build(spec: Any, size: float) -> None:
        joint = spec.joint(d.name)
        ring = joint.parent.add_body(name=f"{d.name}_ring")
        inner = ring.add_joint(
            name=f"{d.name}_ring", type=joint.type, axis=joint.axis, pos=joint.pos, armature=1e-3,
            limited=mujoco.mjtLimited.mjLIMITED_TRUE, range=[-gap / 2, gap / 2], solref_limit=[4 * STEP, 1.0],
        )  # fmt: skip
        ring.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], pos=joint.pos, mass=0.01,
                      contype=0, conaffinity=0)  # fmt: skip
        rubs = spec.add_tendon(name=f"{d.name}_rubs", frictionloss=size * d.arm.coulomb[d.joint])
        rubs.solref_friction = [2.0 * STEP, 1.0]
        rubs.solimp_friction = [0.9999, 0.9999, 0.001, 0.5, 2.0]  # for a light ring, else it is viscous below .3 rad/s
        for name in (d.name, inner.name):
            rubs.wrap_joint(name, 1.0)

    return build


def torque_ripple(d: Draw) -> Build:
    """Magnets of a motor behind its gear, once or twice a motor turn."""
    times, phase = int(d.choose("1", "2")), d.rng.uniform(-np.pi, np.pi)

    def build(spec: Any, size: float) -> None:
        motor(spec, d.name, cogging=[size, times * GEAR, phase])

    return build


def behind_gear(spec: Any, d: Draw) -> Any:
    """Part link from motor: a second hinge on the same axis; friction and rotor stay with the motor."""
    joint = spec.joint(d.name)
    return joint.parent.add_joint(name=f"{d.name}_gear", type=joint.type, axis=joint.axis, pos=joint.pos)


def joint_elasticity(d: Draw) -> Build:
    """A gear that yields."""

    def build(spec: Any, size: float) -> None:
        gear = behind_gear(spec, d)
        gear.stiffness, gear.damping = [5000.0 / size, 0.0, 0.0], [2.0, 0.0, 0.0]

    return build


def backlash(d: Draw) -> Build:
    """A gear with play between two stiff contacts."""

    def build(spec: Any, size: float) -> None:
        gear = behind_gear(spec, d)
        gap = 1e-3 * size
        gear.limited, gear.range = mujoco.mjtLimited.mjLIMITED_TRUE, [-gap / 2, gap / 2]
        gear.solref_limit, gear.damping = [4 * STEP, 1.0], [0.05, 0.0, 0.0]

    return build


def time_delay(d: Draw) -> Build:
    """An effort that its sensor tells late."""

    def build(spec: Any, size: float) -> None:
        effort_sensor(spec, d.joint, late=max(1, round(5e-3 * size / STEP)))

    return build


def base_tilt(d: Draw) -> Build:
    """A base that is not level."""
    way = d.rng.uniform(-np.pi, np.pi)

    def build(spec: Any, size: float) -> None:
        lean = 0.01 * size
        side = np.array([np.cos(way), np.sin(way), 0.0])
        spec.option.gravity = 9.81 * (np.sin(lean) * side - np.cos(lean) * np.array([0.0, 0.0, 1.0]))

    return build


def wrist_coupling(d: Draw) -> Build:
    """A shaft that turns with two neighbouring joints and rubs."""
    damping = d.rng.uniform(0.0, 1.0)

    def build(spec: Any, size: float) -> None:
        tendon = spec.add_tendon(name=f"{d.name}_shaft", frictionloss=size, damping=[damping * size, 0.0, 0.0])
        tendon.solref_friction = [2.0 * STEP, 1.0]
        tendon.wrap_joint(d.arm.joints[d.joint - 1], 1.0)
        tendon.wrap_joint(d.name, 1.0)

    return build


def position_friction(d: Draw) -> Build:
    """A pad on a spring rubs on a ball that sits a little off the axis, so that it is pressed more here than there."""
    there = place(d.arm, d.joint)
    side = np.cross(there.axis, [0.3, 0.5, 0.8])
    side /= np.linalg.norm(side)
    other = np.cross(there.axis, side)
    turn, off, radius, squeeze = d.rng.uniform(-np.pi, np.pi), 0.0005, 0.05, 0.001

    def build(spec: Any, size: float) -> None:
        push = 0.5 * size * d.arm.coulomb[d.joint] / (0.5 * radius)  # N on average, at a friction of .5
        centre = there.anchor + off * (np.cos(turn) * side + np.sin(turn) * other)
        ball = spec.body(there.link.name)
        local = np.array(there.link.xmat).reshape(3, 3).T @ (centre - np.array(there.link.xpos))
        ball.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], pos=local, mass=0.0, contype=1, conaffinity=2,
            friction=[0.5, 0.0, 0.0], solref=[4 * STEP, 1.0],
        )  # fmt: skip
        carrier = spec.body(there.parent.name)
        frame = np.array(there.parent.xmat).reshape(3, 3).T
        thick = 0.01
        pad = carrier.add_body(
            name=f"{d.name}_pad", pos=frame @ (there.anchor + side * (radius + thick) - np.array(there.parent.xpos))
        )
        towards = frame @ side
        pad.add_joint(
            name=f"{d.name}_pad", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=towards, stiffness=[push / squeeze, 0, 0],
            springref=-squeeze, damping=[50.0, 0, 0], armature=0.0,
        )  # fmt: skip
        quat = np.empty(4)
        mujoco.mju_quatZ2Vec(quat, towards)
        pad.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.05, 0.05, thick], quat=quat, mass=0.05, contype=2, conaffinity=1,
            friction=[0.5, 0.0, 0.0], solref=[4 * STEP, 1.0],
        )  # fmt: skip

    return build


def fluid(d: Draw) -> Build:
    """Every link moves through something thick."""
    thick = d.between(0.1, 10.0)

    def build(spec: Any, size: float) -> None:
        spec.option.density, spec.option.viscosity = 300.0 * size, 3.0 * thick * size

    return build


def external_force(d: Draw) -> Build:
    """A rope in space from a post beside the base to the end of the link, elastic or yielding."""
    near, far = place(d.arm, 0), place(d.arm, d.joint + 1)
    post = near.anchor + np.array([d.rng.uniform(-0.4, 0.4), d.rng.uniform(-0.4, 0.4), d.rng.uniform(0.2, 0.8)])
    rest, gives = d.rng.uniform(0.0, 0.6), d.rng.random() < 0.3

    def build(spec: Any, size: float) -> None:
        settings = {"springyield": 0.05} if gives else {}
        tendon = spec.add_tendon(name="hose", stiffness=[20.0 * size, 0, 0], springlength=[0.0, rest], **settings)
        tendon.wrap_site(near.site(spec, on_link=False, at=post, name="hook"))
        tendon.wrap_site(far.site(spec, on_link=True, at=far.anchor, name="eye"))

    return build


def pendulum(d: Draw) -> Build:
    """Something that swings freely from the last link."""
    length, tilt = d.between(0.05, 0.3), d.rng.normal(size=3)

    def build(spec: Any, size: float) -> None:
        link = spec.joint(d.arm.joints[-1]).parent
        bob = link.add_body(name="bob", pos=[0.0, 0.0, 0.05])
        bob.add_joint(name="bob", axis=tilt / np.linalg.norm(tilt), damping=[0.01 * size, 0, 0])
        bob.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0], pos=[length, 0, 0], mass=0.3 * size,
                     contype=0, conaffinity=0)  # fmt: skip

    return build


def slosh(d: Draw) -> Build:
    """A mass that slides on a spring within a link."""
    axis, host = d.rng.normal(size=3), int(d.rng.integers(1, len(d.arm.joints) - 1))
    frequency = d.between(1.0, 5.0)

    def build(spec: Any, size: float) -> None:
        mass = 0.5 * size
        tank = spec.joint(d.arm.joints[host]).parent.add_body(name="tank", pos=[0.05, 0.05, 0.1])
        stiff = mass * (2 * np.pi * frequency) ** 2
        tank.add_joint(
            name="tank", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis / np.linalg.norm(axis), stiffness=[stiff, 0, 0],
            damping=[0.1 * np.sqrt(stiff * mass), 0, 0],
        )  # fmt: skip
        tank.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0], mass=mass, contype=0, conaffinity=0)

    return build


def soft_base(d: Draw) -> Build:
    """A pedestal that rocks."""
    frequency, axis = d.between(3.0, 8.0), np.array([*d.rng.normal(size=2), 0.0])

    def build(spec: Any, size: float) -> None:
        first = spec.joint(d.arm.joints[0]).parent
        inertia = 20.0
        first.add_joint(
            name="rock", axis=axis / np.linalg.norm(axis), armature=inertia / size, damping=[20.0, 0, 0],
            stiffness=[inertia / size * (2 * np.pi * frequency) ** 2, 0, 0],
        )  # fmt: skip

    return build


def rubbing(d: Draw) -> Build:
    """The last link rubs on a wall that gives way."""
    far, depth = place(d.arm, len(d.arm.joints) - 1), d.rng.uniform(0.02, 0.2)
    normal = d.rng.normal(size=3)
    normal /= np.linalg.norm(normal)

    def build(spec: Any, size: float) -> None:
        link = spec.body(far.link.name)
        link.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0], mass=0.0, contype=1, conaffinity=2)
        quat = np.empty(4)
        mujoco.mju_quatZ2Vec(quat, -normal)
        at = np.array(far.link.xpos) + normal * (0.4 - depth)
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1], pos=at, quat=quat, contype=2, conaffinity=1,
            solref=[-400.0 * size, -20.0], solimp=[0.5, 0.5, 0.001, 0.5, 2.0], friction=[0.4, 0, 0],
        )  # fmt: skip

    return build


KNOWN: dict[str, Callable[[Draw], Build]] = {
    one.__name__: one
    for one in (
        cable, gravity_spring, end_stop, viscous_nonlinear, stribeck, presliding, torque_ripple, joint_elasticity,
        backlash, time_delay, base_tilt, wrist_coupling, position_friction, friction_behind_play,
        external_force,
    )
}  # fmt: skip
UNKNOWN: dict[str, Callable[[Draw], Build]] = {
    one.__name__: one for one in (fluid, pendulum, slosh, soft_base, rubbing)
}
OF_ROBOT = ("base_tilt",)
"""Those that have no joint."""


def joints_of(name: str, arm: Arm) -> list[int]:
    """Return on which joints an effect can be."""
    n = len(arm.joints)
    return {
        "gravity_spring": [1],
        "joint_elasticity": [0, 1, 2, 3],
        "backlash": [0, 1, 2, 3],
        "wrist_coupling": list(range(n - 2, n)),
        "external_force": list(range(2, n - 1)),
    }.get(name, list(range(n)))
