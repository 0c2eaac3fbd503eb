"""What the second simulator hides: each effect in one or several formulas that the product's catalogue does not use.

A maker draws what is random and returns the effect as a function of scene and size; size 1 is usual.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from foreign.arm import COULOMB, GEAR, TORQUE_LIMIT, VISCOUS, Array, links_torque
from foreign.memory import dahl, gapped, lugre, slipping
from foreign.world import Hidden, Scene, Seen

Law = Callable[[Scene, float], Array]


@dataclass(frozen=True)
class Draw:
    """What a maker may draw from: random numbers, the joint, and the scenes that the effect is made for."""

    rng: np.random.Generator
    joint: int
    scenes: tuple[Scene, ...]

    def between(self, low: float, high: float) -> float:
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def choose(self, *options: str) -> str:
        return str(self.rng.choice(options))

    @property
    def positions(self) -> Array:
        return np.concatenate([scene.path.q[:, self.joint] for scene in self.scenes])

    @property
    def other(self) -> int:
        return int(self.rng.choice([k for k in range(3) if k != self.joint]))


def beside(joint: int, law: Law) -> Hidden:
    """Return the effect of a torque [N] that one joint's drive gives besides."""

    def hidden(scene: Scene, size: float) -> Seen:
        torque = scene.torque.copy()
        torque[:, joint] += law(scene, size)
        return Seen(scene.path.q, torque)

    return hidden


def stribeck(d: Draw) -> Hidden:
    """A fall by a Lorentzian (Hess and Soom 1990), a hyperbola, or an exponential of an odd power."""
    form, vs, j = d.choose("lorentz", "hyperbola", "power"), d.between(0.015, 0.12), d.joint
    power = d.rng.uniform(0.8, 1.6)

    def law(scene: Scene, size: float) -> Array:
        v = np.abs(scene.path.dq[:, j])
        x = v / vs
        fall = {"lorentz": 1 / (1 + x**2), "hyperbola": 1 / (1 + x) ** 2, "power": np.exp(-(x**power))}
        return 20 * size * np.sign(scene.path.dq[:, j]) * fall[form]

    return beside(j, law)


def viscous_nonlinear(d: Draw) -> Hidden:
    """A level that is reached exponentially, a root, a cube, or a logarithm of speed."""
    form, v0, j = d.choose("saturates", "root", "cube", "logarithm"), d.between(0.1, 0.4), d.joint

    def law(scene: Scene, size: float) -> Array:
        v = np.abs(scene.path.dq[:, j])
        bend = {"saturates": 1 - np.exp(-v / v0), "root": v**0.4, "cube": v**3, "logarithm": np.log1p(v / v0)}
        return 15 * size * np.sign(scene.path.dq[:, j]) * bend[form]

    return beside(j, law)


def presliding(d: Draw) -> Hidden:
    """The joint's Coulomb friction by LuGre, by Dahl's law of exponent 2, or by ten slipping elements."""
    form, reach, j = d.choose("lugre", "dahl", "slipping"), d.between(0.004, 0.015), d.joint

    def law(scene: Scene, size: float) -> Array:
        q, v, dt = scene.path.q[:, j], scene.path.dq[:, j], scene.path.dt
        x0 = reach * size
        z = {"lugre": lambda: lugre(v, x0, dt), "dahl": lambda: dahl(v, x0, dt), "slipping": lambda: slipping(q, x0)}
        return COULOMB[j] * (z[form]() - np.sign(v))

    return beside(j, law)


def load_friction(d: Draw) -> Hidden:
    """A gear's efficiency, another one when it drives than when it is driven; or friction in proportion to load."""
    ratio, j = d.rng.uniform(0.7, 1.3), d.joint

    def law(scene: Scene, size: float) -> Array:
        load, v = scene.load[:, j], scene.path.dq[:, j]
        loss = np.where(load * v > 0, 1.0, ratio)
        return 0.06 * size * loss * np.abs(load) * np.sign(v)

    return beside(j, law)


def position_friction(d: Draw) -> Hidden:
    """A level that varies over a turn as a trapezoid, a triangle, or a sine with a little of the second."""
    form, at, j = d.choose("trapezoid", "triangle", "sine"), d.rng.uniform(-np.pi, np.pi), d.joint
    second, phase = d.rng.uniform(0.0, 0.2), d.rng.uniform(-np.pi, np.pi)

    def law(scene: Scene, size: float) -> Array:
        x = scene.path.q[:, j] - at
        triangle = 2 / np.pi * np.arcsin(np.cos(x))
        shape = {
            "trapezoid": np.clip(1.6 * triangle, -1, 1),
            "triangle": triangle,
            "sine": np.cos(x) + second * np.cos(2 * x + phase),
        }
        return 0.3 * COULOMB[j] * size * np.sign(scene.path.dq[:, j]) * shape[form]

    return beside(j, law)


def torque_ripple(d: Draw) -> Hidden:
    """Cogging of the motor, with a third of it at twice the angle now and then."""
    h, phase, more = d.rng.choice([0.5, 1.0, 2.0, 4.0]), d.rng.uniform(-np.pi, np.pi), d.rng.uniform(0.0, 0.3)
    j = d.joint

    def law(scene: Scene, size: float) -> Array:
        angle = h * GEAR[j] * scene.path.q[:, j] + phase
        return 4 * size * (np.sin(angle) + more * np.sin(2 * angle + 1))

    return beside(j, law)


def backlash(d: Draw) -> Hidden:
    """A gap between two flanks that meet softly, the link's own motion simulated in it."""
    stiffness, damping, j = d.between(2e5, 8e5), d.rng.uniform(0.05, 0.2), d.joint

    def hidden(scene: Scene, size: float) -> Seen:
        driven = scene.path
        link = gapped(driven, scene.links[:, j], j, 1e-3 * size, stiffness, damping)
        torque = scene.torque + links_torque(link) - scene.links
        return Seen(driven.q, torque)

    return hidden


def cable(d: Draw) -> Hidden:
    """A hose that bends about its middle, a little stiffer outwards, with strands that rub."""
    at, cube, rub, j = d.rng.uniform(-0.4, 0.4), d.rng.uniform(0.01, 0.1), d.rng.uniform(0.0, 0.05), d.joint
    steep = np.sqrt(6 * cube)

    def law(scene: Scene, size: float) -> Array:
        bent = scene.path.q[:, j] - at
        return 12 * size * (np.sinh(steep * bent) / steep + rub * slipping(bent, 0.15))

    return beside(j, law)


def gravity_spring(d: Draw) -> Hidden:
    """A spring from a post to the second link, its force along the line between its ends."""
    post, lever, j = d.rng.uniform(0.35, 0.6), d.rng.uniform(0.1, 0.2), d.joint

    def law(scene: Scene, size: float) -> Array:
        q = scene.path.q[:, j]
        end = lever * np.stack([np.sin(q), np.cos(q)])
        line = end - np.array([[0.0], [post]])
        length = np.linalg.norm(line, axis=0)
        force = 4000 * size * (length - (post - lever)) * line / length
        return force[0] * end[1] - force[1] * end[0]

    return beside(j, law)


def base_tilt(d: Draw) -> Hidden:
    """A floor that isn't level: the whole field of gravity turns."""
    direction = d.rng.uniform(-np.pi, np.pi)

    def hidden(scene: Scene, size: float) -> Seen:
        tilt = min(0.02 * size, 1.0)
        across = 9.81 * np.sin(tilt) * np.array([np.cos(direction), np.sin(direction)])
        turned = links_torque(scene.path, (float(across[0]), float(across[1]), float(-9.81 * np.cos(tilt))))
        return Seen(scene.path.q, scene.torque + turned - scene.links)

    return hidden


def torque_saturation(d: Draw) -> Hidden:
    """Iron that saturates: the current grows faster than the torque, by an inverse tanh or a rational function."""
    form, j = d.choose("tanh", "rational"), d.joint

    def hidden(scene: Scene, size: float) -> Seen:
        torque = scene.torque.copy()
        share = torque[:, j] / TORQUE_LIMIT[j]
        torque[:, j] *= 1 + 0.15 * size * (share**2 if form == "rational" else np.abs(np.tanh(1.5 * share)))
        return Seen(scene.path.q, torque)

    return hidden


def time_delay(d: Draw) -> Hidden:
    """Torque stamped late or early by a fraction of samples, of one joint."""
    sign, j = d.rng.choice([-1.0, 1.0]), d.joint

    def hidden(scene: Scene, size: float) -> Seen:
        torque = scene.torque.copy()
        steps = np.arange(len(torque)) - sign * 0.006 * size / scene.path.dt
        torque[:, j] = np.interp(steps, np.arange(-len(torque), 2 * len(torque)), np.tile(torque[:, j], 3))
        return Seen(scene.path.q, torque)

    return hidden


def encoder_eccentricity(d: Draw) -> Hidden:
    """A scale out of centre: the angle reads wrong by a sine, once or twice a turn."""
    h, phase, j = d.rng.choice([1.0, 2.0]), d.rng.uniform(-np.pi, np.pi), d.joint

    def hidden(scene: Scene, size: float) -> Seen:
        q = scene.path.q.copy()
        q[:, j] += 0.006 * size * np.sin(h * q[:, j] + phase)
        return Seen(q, scene.torque)

    return hidden


def rotor_inertia(d: Draw) -> Hidden:
    """The third drive's rotor, which has no column of its own in the paper's model."""
    return beside(2, lambda scene, size: 2.0 * size * scene.path.ddq[:, 2])


def joint_coupling(d: Draw) -> Hidden:
    """Bearings that the motion of another joint drags along."""
    other, share, j = d.other, d.rng.uniform(0.2, 0.9), d.joint

    def law(scene: Scene, size: float) -> Array:
        v = scene.path.dq[:, other]
        return 8 * size * (share * np.tanh(v / 0.02) + (1 - share) * v)

    return beside(j, law)


def torque_offset(d: Draw) -> Hidden:
    """Coulomb friction that differs between the two directions."""
    sign, j = d.rng.choice([-1.0, 1.0]), d.joint
    return beside(j, lambda scene, size: sign * 4 * size * np.ones(len(scene.path.q)))


def viscous_asymmetric(d: Draw) -> Hidden:
    """Viscous friction that differs between the two directions."""
    sign, j = d.rng.choice([-1.0, 1.0]), d.joint
    return beside(j, lambda scene, size: sign * 4 * size * np.abs(scene.path.dq[:, j]))


def end_stop(d: Draw) -> Hidden:
    """A bumper whose force rises with a power of how far it is pressed in."""
    side, power, j = d.rng.choice([-1.0, 1.0]), d.rng.uniform(1.0, 1.6), d.joint
    start = np.quantile(side * d.positions, 1 - d.rng.uniform(0.06, 0.2))

    def law(scene: Scene, size: float) -> Array:
        pressed = np.maximum(side * scene.path.q[:, j] - start, 0.0)
        return side * 60 * size * pressed**power

    return beside(j, law)


def temperature_drift(d: Draw) -> Hidden:
    """Grease that warms up: viscous friction falls by a third or so."""
    slow, j = d.rng.uniform(40.0, 120.0), d.joint

    def hidden(scene: Scene, size: float) -> Seen:
        warm = scene.torque.copy()
        warm[:, j] -= min(0.4 * size, 0.9) * VISCOUS[j] * scene.path.dq[:, j]
        return Seen(scene.path.q, scene.torque, warm, slow)

    return hidden


def bump(d: Draw) -> Hidden:
    """A dent at one angle."""
    at, j = np.quantile(d.positions, d.rng.uniform(0.25, 0.75)), d.joint
    width, sign = d.rng.uniform(0.04, 0.1), d.rng.choice([-1.0, 1.0])
    return beside(j, lambda scene, size: sign * 15 * size / (1 + ((scene.path.q[:, j] - at) / width) ** 2))


def sawtooth(d: Draw) -> Hidden:
    """A toothed profile over position, at a ratio that no gear has."""
    teeth, phase, j = d.rng.uniform(5.0, 20.0), d.rng.uniform(0, 1), d.joint
    return beside(j, lambda scene, size: 10 * size * ((teeth * scene.path.q[:, j] / 2 + phase) % 1 - 0.5))


def pump(d: Draw) -> Hidden:
    """A disturbance that doesn't care for the motion."""
    lines, phase, j = d.rng.integers(7, 60), d.rng.uniform(-np.pi, np.pi), d.joint

    def law(scene: Scene, size: float) -> Array:
        turn = np.linspace(0, 2 * np.pi, len(scene.path.q), endpoint=False)
        return 5 * size * np.cos(lines * turn + phase + scene.number)

    return beside(j, law)


def wind(d: Draw) -> Hidden:
    """Smooth noise in time, another one in every motion."""
    seed, j = int(d.rng.integers(1 << 31)), d.joint

    def law(scene: Scene, size: float) -> Array:
        rng, samples = np.random.default_rng([seed, scene.number]), len(scene.path.q)
        lines = np.zeros(samples // 2 + 1, complex)
        lines[1:40] = rng.standard_normal(39) + 1j * rng.standard_normal(39)
        return 5 * size * np.fft.irfft(lines, samples) * samples / np.sqrt(2 * 2 * 39)

    return beside(j, law)


def pose_field(d: Draw) -> Hidden:
    """A torque over the pose of two joints that is no link's gravity."""
    other, phase, j = d.other, d.rng.uniform(-np.pi, np.pi, 2), d.joint
    k = d.rng.uniform(3.0, 5.0, 2)

    def law(scene: Scene, size: float) -> Array:
        q = scene.path.q
        return 6 * size * np.sin(k[0] * q[:, j] + phase[0]) * np.sin(k[1] * q[:, other] + phase[1])

    return beside(j, law)


def braking(d: Draw) -> Hidden:
    """Friction that depends on where another joint stands and on how fast this one speeds up."""
    other, j = d.other, d.joint

    def law(scene: Scene, size: float) -> Array:
        motion = scene.path
        return 10 * size * np.sign(motion.dq[:, j]) * np.sin(4 * motion.q[:, other]) * np.tanh(motion.ddq[:, j])

    return beside(j, law)


KNOWN: dict[str, Callable[[Draw], Hidden]] = {
    made.__name__: made
    for made in (
        stribeck,
        viscous_nonlinear,
        presliding,
        load_friction,
        position_friction,
        torque_ripple,
        backlash,
        cable,
        gravity_spring,
        base_tilt,
        torque_saturation,
        time_delay,
        encoder_eccentricity,
        rotor_inertia,
        joint_coupling,
        torque_offset,
        viscous_asymmetric,
        end_stop,
        temperature_drift,
    )
}
"""Effects that the catalogue knows by this name."""

UNKNOWN: dict[str, Callable[[Draw], Hidden]] = {
    made.__name__: made for made in (bump, sawtooth, pump, wind, pose_field, braking)
}
"""Phenomena that are no effect of the catalogue."""

JOINTS = {"rotor_inertia": (2,), "gravity_spring": (1,)}
"""Where an effect can be, where not at every joint."""
