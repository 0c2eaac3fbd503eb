"""`robot_ident VERB`: finds the verb, calls it, and turns our own errors into one line and an exit code."""

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
from robot_ident.cli.effects_from import add_effects_from, register_effects
from robot_ident.cli.output import Parser, flush, refuse_own_input, tell
from robot_ident.errors import InputError, RobotIdentError, one_line
from robot_ident.memory import OUT_OF_MEMORY, bounded
from robot_ident.parallel import came, end_by, on_cluster

# verb: what it does, in the order in which they are used
VERBS: dict[str, str] = {
    "init": "describe your own robot: what a URDF and a recording say, what is guessed and what is missing",
    "demo": "the whole story on a simulated KUKA, with the real nodes",
    "design": "optimise an excitation within the robot's limits",
    "check": "certify the limits of an excitation over continuous time",
    "simulate": "record the simulated robot, faster than real time",
    "replay": "publish a recording on joint_states with its own timing",
    "recover": "make a whole bag of a truncated one",
    "info": "what is in a bag: topics, joints, rate, periods, noise",
    "identify": "estimate the parameters with their uncertainty",
    "predict": "the model's torque along a recording, with its band",
    "validate": "predict an independent recording",
    "compare": "model beside measurement: where it fails, against the noise floor",
    "diagnose": "which physical effect is missing, with evidence",
    "add": "add effects to a model and print the error before and after",
    "workbench": "the same loop in the browser: compare, see, learn, add, watch",
    "report": "one page to read and to mail: the verdict, and all that it rests on",
    "effects": "the catalogue of physical effects",
    "trial": "hide effects in the simulated robot, and count how often they are named",
    "export": "physically consistent URDF or MJCF, or C code for a controller",
    "montecarlo": "bias and efficiency of the estimator over repeated noise",
}


EFFECTLESS = ("demo", "replay", "recover")
"""Verbs that make no effect; all others take `--effects-from`."""


def build_parser(only: str | None = None) -> argparse.ArgumentParser:
    """Return the parser; the options of `only` one verb (or of all) are loaded."""
    parser = Parser(
        prog="robot_ident",
        description="Turns an excited robot into a model that engineers trust, and says which physics it lacks.",
    )
    parser.add_argument("--version", action="version", version=f"robot_ident {__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True, parser_class=Parser)
    for name, text in VERBS.items():
        verb = verbs.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        if only in (None, name):
            importlib.import_module(f"robot_ident.cli.{name}").add_arguments(verb)
            if name not in EFFECTLESS:
                add_effects_from(verb)
    return parser


_SERVERS = ("workbench",)  # which start a browser: their workers bound themselves


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    for stream in ("stdout", "stderr"):
        if getattr(sys, stream) is None:  # closed by who started us: what is printed goes nowhere
            setattr(sys, stream, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))
    verb = next((word for word in words if not word.startswith("-")), None)
    with _interrupts():
        return _run(words, verb)


def _run(words: list[str], verb: str | None) -> int:
    try:
        args = build_parser(verb if verb in VERBS else "").parse_args(words)
        refuse_own_input(args)
        register_effects(getattr(args, "effects_from", []))
        own = nullcontext() if args.verb in _SERVERS else bounded()
        with own, on_cluster(getattr(args, "cluster", None)):
            code = int(importlib.import_module(f"robot_ident.cli.{args.verb}").run(args) or 0)
            flush()
            return code
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
    """Start the console script."""
    sys.exit(main())


if __name__ == "__main__":
    entry()
