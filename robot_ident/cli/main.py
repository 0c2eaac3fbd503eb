"""`robot_ident COMMAND`: finds the command, calls it, and turns our own errors into one line and an exit code; the
help lists the commands by what they are for.
"""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from types import FrameType

from robot_ident import __version__
from robot_ident.cli.options import EFFECTS_FROM, TAKES
from robot_ident.cli.output import Parser, flush, refuse_outputs, tell
from robot_ident.errors import InputError, RobotIdentError, did_you_mean, one_line
from robot_ident.memory import OUT_OF_MEMORY, bounded
from robot_ident.parallel import came, end_by, on_cluster

DESCRIPTION = (
    "Identify the dynamics of a robot arm from a ROS 2 bag: inertial and friction parameters with uncertainty,"
    " and which physical effect the model still lacks."
)

HINT = "Start with: robot_ident demo. Options of a command: robot_ident COMMAND --help."

GROUPS: dict[str, dict[str, str]] = {
    "Plan": {
        "init": "describe your robot: write a robot YAML from a URDF and a recording, with what is guessed or missing",
        "design": "optimise an excitation trajectory within the robot's limits",
        "check": "check the limits of a motion over continuous time",
    },
    "Record": {
        "simulate": "record a simulated robot, faster than real time",
        "replay": "publish a recording on joint_states with its original timing",
        "info": "show what a recording holds: topics, joints, sample rate, periods, noise",
        "filter": "identify the anti-alias filter of the torque channel from its frequency response",
        "recover": "rewrite a truncated bag as a complete one",
    },
    "Identify": {
        "identify": "estimate the dynamic parameters with their uncertainty",
        "validate": "predict an independent recording and print the residual of each joint",
        "predict": "predict the torque along a motion with its uncertainty",
        "montecarlo": "measure bias and efficiency of the estimator over repeated noise",
    },
    "Diagnose": {
        "compare": "compare a model with recordings: where and by how much the residual exceeds the noise",
        "diagnose": "name the physical effect that the model lacks, with the evidence",
        "add": "add effects to a model and print the error before and after",
        "effects": "list the catalogue of physical effects, or explain one",
        "workbench": "compare, diagnose and extend a model in the browser",
        "report": "write the verdict and its evidence as one HTML page",
    },
    "Hand on": {
        "export": "export a model as physically consistent URDF or MJCF, or as C code for a controller",
    },
    "Learn": {
        "demo": "run the end-to-end example: a simulated KUKA arm and the real ROS 2 nodes",
        "paper": "compute Swevers et al. (1997) again: every table and figure next to the printed one, on one page",
        "trial": "hide effects in a simulated robot and count how often the diagnosis names them",
    },
}
"""Purpose: command: what it does."""


class Commands(Parser):
    """The parser of the command line's first word, whose help lists the commands under their purposes."""

    def format_help(self) -> str:
        """Return usage, description, the commands and the options."""
        form = self._get_formatter()
        form.add_usage("robot_ident COMMAND [OPTION...]", [], [])
        form.add_text(self.description)
        for title, commands in GROUPS.items():
            form.start_section(title)
            form.add_arguments(argparse.Action([], name, metavar=name, help=text) for name, text in commands.items())
            form.end_section()
        form.start_section("Options")
        form.add_arguments(action for action in self._actions if action.option_strings)
        form.end_section()
        form.add_text(self.epilog)
        return form.format_help()


VERBS = {name: text for commands in GROUPS.values() for name, text in commands.items()}
"""What each command does, in the order of the help."""

EFFECTLESS = ("demo", "paper", "replay", "recover")
"""Commands that make no effect; all others take `--effects-from`."""


def build_parser(only: str | None = None) -> argparse.ArgumentParser:
    """Return the parser; the options of `only` one command (or of all) are loaded."""
    parser = Commands(prog="robot_ident", description=DESCRIPTION, epilog=HINT)
    parser.add_argument("--version", action="version", version=f"robot_ident {__version__}")
    verbs = parser.add_subparsers(
        prog="robot_ident", dest="verb", metavar="COMMAND", required=True, parser_class=Parser
    )
    for name, text in VERBS.items():
        verb = verbs.add_parser(name, description=text[0].upper() + text[1:] + ".")
        if only in (None, name):
            for one in (*TAKES[name], *(() if name in EFFECTLESS else (EFFECTS_FROM,))):
                one.add_to(verb)
    return parser


_SERVERS = ("workbench",)  # which start a browser: their workers bound themselves


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    words = list(sys.argv[1:] if argv is None else argv) or ["--help"]
    if words[0] == "help":
        words = [*words[1:2], "--help"]
    for stream in ("stdout", "stderr"):
        if getattr(sys, stream) is None:  # closed by who started us: what is printed goes nowhere
            setattr(sys, stream, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))
    verb = next((word for word in words if not word.startswith("-")), None)
    with _interrupts():
        return _run(words, verb)


def _run(words: list[str], verb: str | None) -> int:
    try:
        parser = build_parser(verb if verb in VERBS else "")
        if verb == words[0] and verb not in VERBS:
            parser.error(f"unknown command {one_line(verb, 100)!r}{did_you_mean(verb, VERBS)}")
        args = parser.parse_args(words)
        refuse_outputs(args)
        if getattr(args, "effects_from", []):
            from robot_ident.cli.values import register_effects

            register_effects(args.effects_from)
        own = nullcontext() if args.verb in _SERVERS else bounded()
        with own, on_cluster(getattr(args, "cluster", None)):
            importlib.import_module(f"robot_ident.cli.{args.verb}").run(args)
            flush()
            return 0
    except RobotIdentError as error:
        tell(f"robot_ident {verb}: {error}")
        return error.exit_code
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        return _stopped(verb)
    except MemoryError:
        tell(f"robot_ident {verb}: {OUT_OF_MEMORY}")
        return InputError.exit_code
    except Exception as error:
        if isinstance(error, OSError) and error.filename is not None and not came:  # a name that no file can have
            tell(f"robot_ident {verb}: {one_line(error.filename)}: {error.strerror or error}; give another name")
            return InputError.exit_code
        if came:
            return _stopped(verb)  # what compiled code, or an import, made of the interrupt
        if isinstance(error, ImportError) and "libgomp" in str(error):
            tell(f"robot_ident {verb}: {error}; pinocchio needs it (Debian, Ubuntu: sudo apt-get install libgomp1)")
            return InputError.exit_code
        raise


def _stopped(verb: str | None) -> int:
    tell(f"robot_ident {verb}: stopped; nothing was written")
    return 128 + (came[0] if came else signal.SIGINT)


_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""What ends a verb like any error: what it holds (nodes, workers, half written files) is released. The first of them
is Ctrl-C, after which a verb may keep what it has so far; the others wait for nothing.
"""


@contextmanager
def _interrupts() -> Iterator[None]:
    """Let signals end the verb."""
    came.clear()

    def interrupt(number: int, frame: FrameType | None) -> None:
        came.append(number)
        end_by(number)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    usual = (signal.default_int_handler, signal.SIG_DFL)  # else a shell has us ignore it, or a program of which we are
    former = {number: handler for number in _ENDING if (handler := signal.getsignal(number)) in usual}
    for number in former:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


def entry() -> None:
    """Start the console script.

    Matrices here are small: threads of the linear algebra wait for each other far longer than they compute, above all
    beside another process. OMP_NUM_THREADS overrules it.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())


if __name__ == "__main__":
    entry()
