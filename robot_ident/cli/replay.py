"""`robot_ident replay`."""

from __future__ import annotations

import argparse

from robot_ident.bags import read_recording
from robot_ident.cli.output import Progress, print_json, say
from robot_ident.errors import InputError


def run(args: argparse.Namespace) -> None:
    """Publish a recording with its own timing."""
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
