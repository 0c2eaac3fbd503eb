"""A verb that is told to end releases what it holds: the nodes of a demo must not go on alone."""

from __future__ import annotations

import signal
import subprocess
import sys

HOLDING = """
import sys, time
from robot_ident.cli import effects
from robot_ident.cli.main import main

def run(args):
    try:
        print("holding", flush=True)
        time.sleep(60)
    finally:
        print("released", flush=True)

effects.run = run
sys.exit(main(["effects"]))
"""


def test_sigterm_releases_what_a_verb_holds() -> None:
    with subprocess.Popen([sys.executable, "-c", HOLDING], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "holding\n"
        process.send_signal(signal.SIGTERM)
        assert process.stdout.read() == "released\n"
    assert process.returncode == 128 + signal.SIGTERM
