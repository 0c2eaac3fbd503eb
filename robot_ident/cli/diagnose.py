"""`robot_ident diagnose`."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from robot_ident.cli.output import print_json, say, table, tell
from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.cli.loop import Inputs
    from robot_ident.diagnosis.diagnosis import Diagnosis, Suspect


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's options."""
    from robot_ident.cli.loop import add_common

    parser.add_argument(
        "inputs", nargs="+", metavar="model.yaml BAG", help="a model and recordings, two or more for a firm verdict"
    )
    parser.add_argument(
        "--add-until-adequate", action="store_true", help="add what is found, and print the falling error"
    )
    parser.add_argument(
        "-o", "--output", metavar="MODEL", help="with --add-until-adequate: the model with what was found"
    )
    parser.add_argument("--force", action="store_true", help="replace what is there")
    add_common(parser)


def run(args: argparse.Namespace) -> int:
    """Say which physical effect is missing."""
    from robot_ident.cli.effects_from import register_effects
    from robot_ident.cli.loop import read_inputs
    from robot_ident.diagnosis.diagnose import diagnose
    from robot_ident.files import refuse_existing

    if args.output:
        refuse_existing(args.output, force=args.force)
    register_effects(args)
    inputs = read_inputs(args.inputs, args.validation, args.topic)
    if len(inputs.models) != 1 or not inputs.measurements:
        raise InputError("diagnose takes one model and at least one recording")
    found = diagnose(inputs.measurements, inputs.models[0].structure, inputs.validation)
    if args.json:
        print_json(found.to_dict())
    else:
        _print(found, inputs)
    if args.add_until_adequate and found.missing:
        _staircase(found, inputs, args)
    return 0


def sentence(found: Diagnosis) -> str:
    """Return the verdict in one sentence."""
    if found.verdict == "adequate":
        return "adequate: what is left over is noise"
    if found.verdict == "missing":
        return "missing: " + ", ".join(s.label for s in found.missing)
    if found.verdict == "not_decidable":
        return "not decidable from these recordings"
    where = f"; {found.unexplained.joint}: {found.unexplained.where}" if found.unexplained else ""
    return f"unexplained: none of the known effects accounts for the error{where}"


def _print(found: Diagnosis, inputs: Inputs) -> None:
    for note in found.notes:
        tell(note)
    say(sentence(found))
    if found.missing or found.others:
        rows = [_row(rank, s, True) for rank, s in enumerate(found.missing, 1)]
        rows += [_row(rank, s, False) for rank, s in enumerate(found.others, len(found.missing) + 1)]
        say()
        say(table(("rank", "effect", "named", "explains", "mse before", "mse after"), rows))
    for suspect in found.missing:
        say(f"\n{suspect.label}: {suspect.effect.meaning}")
        for p in suspect.parameters:
            say(f"  {p.name} = {p.value:.4g}{f' +- {p.std:.2g}' if p.std else ''} {p.unit}".rstrip())
        if suspect.tied_with:
            say(f"  these recordings can't tell it from {', '.join(suspect.tied_with)}")
        if suspect.tied_with and suspect.experiment:
            say(f"  what would tell: {suspect.experiment}")
    say()
    say(table(("joint", "remains, Nm rms beyond noise"), list(found.remaining_rms.items())))


def _row(rank: int, s: Suspect, named: bool) -> tuple[object, ...]:
    joint = s.effect.place or max(s.mse_before, key=lambda name: s.mse_before[name] - s.mse_after[name])
    share = f"{100 * s.explained:.0f} %"
    return (rank, s.label, "missing" if named else "-", share, s.mse_before[joint], s.mse_after[joint])


def _staircase(found: Diagnosis, inputs: Inputs, args: argparse.Namespace) -> None:
    from robot_ident.cli.add import extend, staircase
    from robot_ident.model.model_file import write_model

    steps = extend(inputs, [s.effect for s in found.missing])
    if not args.json:
        say()
        say(staircase(inputs, steps))
    if args.output:
        write_model(steps[-1], args.output, force=args.force)
        if not args.json:
            say(f"written: {args.output}")
