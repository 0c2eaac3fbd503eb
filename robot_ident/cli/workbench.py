"""`robot_ident workbench`."""

from __future__ import annotations

import argparse
import shlex
import sys
from contextlib import ExitStack
from pathlib import Path

from robot_ident.cli.output import say
from robot_ident.errors import InputError
from robot_ident.model.model_file import is_model
from robot_ident.workbench.allowed_paths import Allowed
from robot_ident.workbench.controller import Desk


def run(args: argparse.Namespace) -> None:
    """Serve the loop of compare, see, learn, add and watch to a browser on this machine."""
    from robot_ident.workbench.server import browsed, serve

    if args.model and not is_model(args.model):
        raise InputError(f"{args.model}: not a model; recordings go after --bag")
    if args.model and not args.bag:
        raise InputError(f"{args.model}: a model needs recordings: --bag BAG...")
    if args.validation and not args.bag:
        raise InputError(f"--validation {args.validation[0]}: needs recordings to fit: --bag BAG...")
    named = [*args.bag, *args.validation, *([args.model] if args.model else [])]
    allowed = Allowed(Path.cwd(), named)
    effects = [str(Path(path).resolve()) for path in args.effects_from]
    folder = Path(args.folder).resolve()
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--folder {args.folder}: is not a folder")
    desk = Desk(folder, allowed, robot=args.robot, topic=args.topic, effects_from=effects)
    session = desk.open(args.bag, args.validation, args.model) if args.bag else None
    page = session.name if session else ""

    with ExitStack() as ending:

        def ready(address: str) -> None:
            if session:
                desk.jobs(session)  # begins to read while the browser starts
            say(f"robot_ident workbench: {address}")
            say(f"session saved in {args.folder}; stop with Ctrl-C")
            sys.stdout.flush()
            if not args.no_browser:
                ending.enter_context(browsed(address, folder))

        try:
            serve(desk, args.port, page, ready)
        except KeyboardInterrupt:
            own = [word for path in args.effects_from for word in ("--effects-from", path)]
            say(f"stopped; resume with: {shlex.join(['robot_ident', 'workbench', *own, '--folder', args.folder])}")
