"""`robot_ident simulate`."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import Any

from robot_ident.bags import write_recording
from robot_ident.cli.output import print_json, say, say_written, tell
from robot_ident.cli.values import numbers_of
from robot_ident.effects import CATALOGUE
from robot_ident.errors import InputError
from robot_ident.files import refuse_existing, write_text
from robot_ident.planning.blends import Playback
from robot_ident.recording.conditions import Conditions, KnownPayload, sidecar
from robot_ident.robot import Robot, load_robot
from robot_ident.robot.robot import at_every_joint
from robot_ident.testbed.phenomena import PHYSICS, plant_physics, values_in_words
from robot_ident.testbed.scenario import draw_scenario, seal, sealed_path
from robot_ident.testbed.simulation import simulate
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.point_to_point import load_motion

_SAMPLE_RATE = 150.0  # Hz, for motions that name none


def run(args: argparse.Namespace) -> None:
    """Record the simulated robot."""
    answer = None if args.hidden is None else sealed_path(args.output)
    if answer is not None:
        refuse_existing(answer, force=args.force)
        if args.effect:
            raise InputError("--hidden and --effect exclude each other, because they might add the same effect")
    _none_of_ones_own(args.effect)
    carried = _payload(args.payload)
    refuse_existing(sidecar(args.output), force=args.force)
    robot = load_robot(args.robot)
    motion = load_motion(args.excitation)
    motion.check_robot(robot)
    scenario = None if args.hidden is None else draw_scenario(args.hidden, robot)
    effects = at_every_joint(args.effect if scenario is None else scenario.all_effects, robot.joints)
    if carried is not None:
        x, y, z = carried.centre
        effects = (*effects, f"payload:payload={carried.mass!r},x={x!r},y={y!r},z={z!r}")
    started = time.perf_counter()
    options: dict[str, Any] = {"servo": args.servo, "seed": args.seed, "effects": effects}
    options["anti_alias"] = args.anti_alias
    if isinstance(motion, Excitation):
        playback = Playback(motion, robot, args.periods)
        steady = (playback.transient, motion.period, args.periods)
        result = simulate(robot, playback, sample_rate=args.sample_rate or motion.sample_rate, steady=steady, **options)
    else:
        result = simulate(robot, motion, sample_rate=args.sample_rate or _SAMPLE_RATE, **options)
    seconds = time.perf_counter() - started
    notes = [*result.notes, *_without_noise(robot)]
    write_recording(args.output, result.recording, force=args.force)
    if carried is not None:
        write_text(sidecar(args.output), Conditions(carried).text(), force=args.force)
    elif args.force:  # what an earlier recording of this name carried
        sidecar(args.output).unlink(missing_ok=True)
    if scenario is not None and answer is not None:
        write_text(answer, seal(scenario), force=args.force)
    if args.json:
        data = {"schema": "robot_ident/simulate/1", "path": str(args.output), "samples": result.recording.samples}
        shown = result.effects if scenario is None else [physics.label for physics in plant_physics(robot)]
        more = {"duration": result.recording.duration, "seconds": seconds, "effects": list(shown)}
        print_json({**data, **more, "sealed": None if answer is None else str(answer), "notes": notes})
        return
    tell(*notes)
    for effect in plant_physics(robot, effects)[-len(effects) :] if scenario is None and effects else ():
        say(f"with {values_in_words(effect.text, robot)}")
    say(f"{result.recording.samples} samples, {result.recording.duration:.1f} s of robot time in {seconds:.2f} s")
    say_written(args.output)
    if answer is not None:
        say(f"hidden effects written: {answer} (robot_ident trial --open {answer} shows them)")


def _none_of_ones_own(effects: Sequence[str]) -> None:
    """Refuse effects of the catalogue that the simulated robot doesn't know: those of --effects-from."""
    for name in (effect.partition(":")[0].partition("@")[0] for effect in effects):
        if name in CATALOGUE and name not in PHYSICS:
            raise InputError(f"--effect {name}: can't be simulated: the simulated robot has physics of its own")


def _payload(text: str | None) -> KnownPayload | None:
    """Return the point mass of `KG` or `KG,X,Y,Z`; InputError on anything else."""
    if text is None:
        return None
    expected = f"--payload {text}: KG or KG,X,Y,Z was expected, the mass above 0"
    values = numbers_of(text, expected, (1, 4))
    if not all(abs(v) < 1e6 for v in values) or not values[0] > 0:
        raise InputError(expected)
    x, y, z = values[1:] or (0.0, 0.0, 0.0)
    return KnownPayload(values[0], (x, y, z))


def _without_noise(robot: Robot) -> list[str]:
    """Return which joints were simulated without torque noise since the robot's files don't know it."""
    quiet = [joint for joint, known in zip(robot.joints, robot.noise.torque_variance >= 0, strict=True) if not known]
    if not quiet:
        return []
    return [f"no torque noise on {', '.join(quiet)}: the robot YAML has no torque_variance (Nm^2) of them"]
