"""`robot_ident simulate`."""

from __future__ import annotations

import argparse
import time
from typing import Any

from robot_ident.cli.output import add_json, add_output, add_robot, print_json, say, tell


_SAMPLE_RATE = 150.0  # Hz, for motions that name none


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's options."""
    parser.add_argument(
        "excitation", metavar="excitation.yaml", help="the motion: an excitation, or a validation motion"
    )
    add_robot(parser)
    parser.add_argument(
        "--periods",
        type=int,
        default=16,
        help="steady periods of an excitation, after one transient (default %(default)s)",
    )
    parser.add_argument(
        "--effect", action="append", default=[], metavar="NAME@JOINT[:k=v,...]", help="further physics of the plant"
    )
    parser.add_argument("--servo", default="feedforward", help="feedforward or pd (default %(default)s)")
    parser.add_argument("--sample-rate", type=float, metavar="HZ", help="default: the excitation's, else 150")
    parser.add_argument(
        "--anti-alias", action="store_true", help="torque passes the analogue filter of the current sensor"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the noise (default %(default)s)")
    add_output(parser, "BAG", "rosbag2 folder to write (or a .mcap, .npz or .csv file)", required=True)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Record the simulated robot."""
    from robot_ident.bags import write_recording
    from robot_ident.errors import InputError
    from robot_ident.excitation.excitation import Excitation
    from robot_ident.excitation.point_to_point import load_motion
    from robot_ident.excitation.playback import Playback
    from robot_ident.files import refuse_existing
    from robot_ident.robot import load_robot
    from robot_ident.simulation.simulate import simulate

    refuse_existing(args.output, force=args.force)
    if args.periods < 1:
        raise InputError(f"--periods {args.periods}: at least 1")
    if args.seed < 0:
        raise InputError(f"--seed {args.seed}: must not be negative")
    robot = load_robot(args.robot)
    motion = load_motion(args.excitation)
    motion.check_robot(robot)
    started = time.perf_counter()
    options: dict[str, Any] = {"servo": args.servo, "seed": args.seed, "effects": args.effect, "anti_alias": args.anti_alias}
    if isinstance(motion, Excitation):
        playback = Playback(motion, robot, args.periods)
        steady = (playback.transient, motion.period, args.periods)
        result = simulate(robot, playback, sample_rate=args.sample_rate or motion.sample_rate, steady=steady, **options)
    else:
        result = simulate(robot, motion, sample_rate=args.sample_rate or _SAMPLE_RATE, **options)
    seconds = time.perf_counter() - started
    write_recording(args.output, result.recording, force=args.force)
    if args.json:
        data = {"schema": "robot_ident/simulate/1", "path": str(args.output), "samples": result.recording.samples}
        more = {"duration": result.recording.duration, "seconds": seconds, "effects": list(result.effects)}
        print_json({**data, **more, "notes": list(result.notes)})
        return 0
    for note in result.notes:
        tell(note)
    say(f"{result.recording.samples} samples, {result.recording.duration:.1f} s of robot time in {seconds:.2f} s")
    say(f"written: {args.output}")
    return 0
