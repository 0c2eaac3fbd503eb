"""`robot_ident replay`."""

from __future__ import annotations

import argparse

from robot_ident.cli.options import add_json, number, option
from robot_ident.cli.output import Progress, print_json, say
from robot_ident.errors import InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("bag", metavar="BAG", help="bag, .npz or .csv")
    number(parser, "--rate", None, (1e-3, 1e4), "playback speed relative to real time", 1.0)
    option(parser, "--topic", None, "topic to publish on", "joint_states")
    option(parser, "--wait", "S", "wait at most S seconds for a subscriber; 0 starts at once", 30.0, type=float)
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
