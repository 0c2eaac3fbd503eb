"""An arm in MuJoCo: links of a URDF, friction and rotors at its joints, a servo that follows imperfectly, sensors."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from mujoco import rollout

Array = np.ndarray[Any, np.dtype[np.float64]]

STEP = 5e-4
"""Of the simulation, s."""
DECIMATE = 8
"""Steps a sample: 250 Hz."""

mujoco.set_mju_user_warning(lambda text: None)  # else it writes a log file; what goes astray raises in `play`

RESTS = 0.02
"""Speed below which a joint may stick, rad/s."""

_INPUTS = (
    int(mujoco.mjtCtrlInput.mjINPUT_POS) | int(mujoco.mjtCtrlInput.mjINPUT_VEL) | int(mujoco.mjtCtrlInput.mjINPUT_FF)
)


@dataclass(frozen=True)
class Motion:
    """Positions q [N, n], velocities, accelerations, evenly over one period, a row every STEP."""

    q: Array
    dq: Array
    ddq: Array


def motion_of(content: dict[str, Any]) -> Motion:
    """Return one period of an excitation file's Fourier series (eq. (11) of the paper), its steps a whole number."""
    steps = round(1.0 / content["base_frequency"] / STEP / DECIMATE) * DECIMATE
    w = 2.0 * np.pi / (steps * STEP)
    t = np.arange(steps) * STEP
    q = np.tile(np.array(content["q0"], dtype=float), (steps, 1))
    for number, (a, b) in enumerate(zip(np.array(content["a"]).T, np.array(content["b"]).T, strict=True), 1):
        q += np.outer(np.sin(w * number * t), a / (w * number)) - np.outer(np.cos(w * number * t), b / (w * number))
    return differentiated(q, STEP)


def differentiated(q: Array, dt: float) -> Motion:
    """Return a motion of periodic positions [N, n] by their Fourier series."""
    w = 2j * np.pi * np.fft.rfftfreq(len(q), dt)[:, None]
    lines = np.fft.rfft(q, axis=0)
    dq, ddq = (np.fft.irfft(lines * w**k, len(q), axis=0) for k in (1, 2))
    return Motion(q, dq, ddq)


@dataclass(frozen=True)
class Servo:
    """Gains for a natural frequency [Hz] and a damping ratio at each joint's mean inertia; `forward`: part of the
    rigid torque that is fed forward.
    """

    frequency: float
    damping: float
    forward: float

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Servo:
        return cls(rng.uniform(6.0, 14.0), rng.uniform(0.6, 1.0), float(rng.choice([0.0, rng.uniform(0.7, 1.0)])))


@dataclass(frozen=True)
class Arm:
    """A URDF's arm; others of its joints are rigid.

    coulomb Nm, viscous Nm s/rad, armature kg m^2, noise Nm of an effort and rad of a position, all [n].
    """

    name: str
    urdf: Path
    joints: tuple[str, ...]
    coulomb: Array
    viscous: Array
    armature: Array
    torque_noise: Array
    position_noise: float

    def spec(self) -> Any:
        """Return its bodies, joints with friction and rotors; no geometry, no actuator."""
        root = ET.parse(self.urdf).getroot()
        for link in root.findall("link"):
            for kind in ("visual", "collision"):
                for part in link.findall(kind):
                    link.remove(part)
        for kind in ("transmission", "gazebo"):
            for part in root.findall(kind):
                root.remove(part)
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
        spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_EULER
        spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 100.0
        for equality in spec.equalities:  # fingers that mimic each other
            spec.delete(equality)
        for joint in spec.joints:
            if joint.name not in self.joints:
                spec.delete(joint)
        for k, name in enumerate(self.joints):
            joint = spec.joint(name)
            joint.damping = [self.viscous[k], 0.0, 0.0]
            joint.frictionloss, joint.armature = self.coulomb[k], self.armature[k]
            joint.solref_friction = [2.0 * STEP, 1.0]  # dry friction as stiff as the step allows
            joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
            joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        return spec

    @cached_property
    def healthy(self) -> Any:
        """Its model as it is, nothing hidden."""
        return self.spec().compile()

    def forward(self, motion: Motion) -> Array:
        """Return the rigid torque [N, n] of the healthy arm along a motion, friction not counted: mj_inverse."""
        model = self.healthy
        data, out = mujoco.MjData(model), np.empty_like(motion.q)
        for row, (q, v, a) in enumerate(zip(motion.q, motion.dq, motion.ddq, strict=True)):
            data.qpos[:], data.qvel[:] = q, v
            data.qacc[:] = 0.0
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            mujoco.mj_mulM(model, data, out[row], a)
            out[row] += data.qfrc_bias
        return out

    def gains(self, servo: Servo, motion: Motion) -> tuple[Array, Array]:
        """Return proportional and derivative gains [n] by each joint's mean inertia along a motion."""
        model = self.healthy
        data, sums = mujoco.MjData(model), np.zeros(len(self.joints))
        full = np.empty((model.nv, model.nv))
        some = motion.q[:: max(1, len(motion.q) // 50)]
        for q in some:
            data.qpos[:] = q
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fullM(model, data, full)
            sums += np.diag(full)
        w = 2.0 * np.pi * servo.frequency
        inertia = sums / len(some)
        return inertia * w**2, 2.0 * servo.damping * w * inertia

    def regressor(self, motion: Motion) -> Array:
        """Return columns [N, n, p] of links, rotors, friction and offsets: what a base model may hold."""
        n = len(self.joints)
        rows = zip(motion.q, motion.dq, motion.ddq, strict=True)
        rigid = np.array([pin.computeJointTorqueRegressor(*self._pinocchio, q, v, a) for q, v, a in rows])
        own = np.eye(n)
        beside = [x[:, :, None] * own for x in (motion.dq, np.sign(motion.dq), motion.ddq, np.ones_like(motion.q))]
        return np.concatenate([rigid, *beside], axis=2)

    @cached_property
    def _pinocchio(self) -> tuple[Any, Any]:
        whole = pin.buildModelFromUrdf(str(self.urdf))
        others = [k for k in range(1, whole.njoints) if whole.names[k] not in self.joints]
        model = pin.buildReducedModel(whole, others, pin.neutral(whole))
        return model, model.createData()


@dataclass(frozen=True)
class Plan:
    """What a servo is told along one motion: setpoints and torque fed forward [N, n], and its gains [n]."""

    motion: Motion
    forward: Array
    kp: Array
    kv: Array

    @classmethod
    def of(cls, arm: Arm, servo: Servo, motion: Motion) -> Plan:
        torque = servo.forward * arm.forward(motion) if servo.forward else np.zeros_like(motion.q)
        return cls(motion, torque, *arm.gains(servo, motion))


Hidden = Callable[[Any], None]
"""What is put into an arm's spec."""


def play(arm: Arm, hidden: Sequence[Hidden], plan: Plan, periods: int, lead: int = 1) -> tuple[Array, Array]:
    """Return positions and efforts [rows, n] as sensors read them without noise, a row a sample.

    The first `lead` periods, in which the arm comes to its steady motion, are not among them.
    """
    spec = arm.spec()
    for put in hidden:
        put(spec)
    for k, name in enumerate(arm.joints):
        actuator = spec.add_actuator(name=f"servo_{k}", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_pid(kp=plan.kp[k], kv=plan.kv[k], ctrlspec=_INPUTS)
        spec.add_sensor(
            name=f"encoder_{k}", type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=name
        )
        if spec.sensor(f"effort_{k}") is None:
            effort_sensor(spec, k)
    model = spec.compile()
    data = mujoco.MjData(model)
    motion, n = plan.motion, len(arm.joints)
    for k, name in enumerate(arm.joints):
        data.joint(name).qpos[:], data.joint(name).qvel[:] = motion.q[0, k], motion.dq[0, k]
    control = np.zeros((len(motion.q), model.nu))
    for k in range(n):
        at = model.actuator_ctrladr[model.actuator(f"servo_{k}").id]
        control[:, at], control[:, at + 1], control[:, at + 2] = motion.q[:, k], motion.dq[:, k], plan.forward[:, k]
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    read: list[Array] = []
    for number in range(periods + lead):
        states, sensed = rollout.rollout(model, data, state[None], control[None])
        state = states[0, -1]
        if number >= lead:
            read.append(sensed[0, ::DECIMATE])
    seen = np.concatenate(read)
    if not np.isfinite(seen).all() or np.abs(seen).max() > 1e5:
        raise ArithmeticError("the simulation went astray")
    columns = {kind: [int(model.sensor(f"{kind}_{k}").adr[0]) for k in range(n)] for kind in ("encoder", "effort")}
    return seen[:, columns["encoder"]], seen[:, columns["effort"]]


def effort_sensor(spec: Any, joint: int, late: int = 0) -> None:
    """Add the sensor of a joint's effort, `late` by so many steps."""
    sensor = spec.add_sensor(
        name=f"effort_{joint}",
        type=mujoco.mjtSensor.mjSENS_ACTUATORFRC,
        objtype=mujoco.mjtObj.mjOBJ_ACTUATOR,
        objname=f"servo_{joint}",
    )
    if late:
        sensor.nsample, sensor.delay = late + 1, late * STEP


def left_over(arm: Arm, seen: Sequence[tuple[Array, Array]]) -> Array:
    """Return what the best base model leaves of steady periods without noise, rms [n] Nm, weighed with the noise.

    Rows in which a joint rests or turns back are left out: dry friction takes any value there.
    """
    columns, torque, moving = [], [], []
    for q, tau in seen:
        motion = differentiated(q, STEP * DECIMATE)
        some = slice(None, None, 5)
        columns.append(arm.regressor(Motion(motion.q[some], motion.dq[some], motion.ddq[some])))
        torque.append(tau[some])
        moving.append(np.abs(motion.dq[some]) > RESTS)
    phi, tau, used = (np.concatenate(parts) for parts in (columns, torque, moving))
    weight = used / arm.torque_noise
    solved = np.linalg.lstsq((phi * weight[:, :, None]).reshape(-1, phi.shape[2]), (tau * weight).ravel(), rcond=1e-9)[
        0
    ]
    return np.sqrt(np.mean(((tau - phi @ solved) * used) ** 2, axis=0))
