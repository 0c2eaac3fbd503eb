"""`robot_ident replay`."""

from __future__ import annotations

import argparse

from robot_ident.cli.output import Progress, add_json, print_json, say, within
from robot_ident.errors import InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("bag", metavar="BAG", help="bag, .npz or .csv")
    parser.add_argument(
        "--rate",
        type=within(1e-3, 1e4),
        default=1.0,
        help="playback speed relative to real time (default: %(default)s)",
    )
    parser.add_argument("--topic", default="joint_states", help="topic to publish on (default: %(default)s)")
    parser.add_argument(
        "--wait",
        type=float,
        default=30.0,
        metavar="S",
        help="wait at most S seconds for a subscriber; 0 starts at once (default: %(default)s)",
    )
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Publish a recording with its own timing."""
    from robot_ident.bags import read_recording

    recording = read_recording(args.bag)
    try:
        from robot_ident.nodes.replay import replay
    except ModuleNotFoundError as error:
        raise InputError(
            f"replay needs ROS 2 ({error.name} is missing); pip install '.[ros]' in the checkout"
        ) from error
    with Progress("replay", 1.0) as bar:
        sent = replay(recording, rate=args.rate, topic=args.topic, wait=args.wait, progress=bar.reach)
    if args.json:
        print_json({"schema": "robot_ident/replay/1", "messages": sent})
    else:
        say(f"{sent} messages published")
    return 0
