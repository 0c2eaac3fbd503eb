"""`robot_ident identify --only payload`: what a known arm carries."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from robot_ident.cli.output import Options, print_json, say, table, tell
from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.estimation.payload import PayloadFit

_MOMENTS = "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"

_OF_THE_MODEL = (
    "--effect",
    "--physical",
    "--joints",
    "--hold",
    "--trajectory",
    "--low-pass",
    "--derivative-bandwidth",
    "--minimum-speed",
    "--anti-alias",
)
"""Options of `identify` that would have no effect here."""


def add_only(parser: Options) -> None:
    """Add the options that leave the arm as a model knows it."""
    parser.add_argument(
        "--only", choices=("payload",), help="estimate the payload and friction alone, on an arm with a known --model"
    )
    parser.add_argument("--model", metavar="MODEL", help="with --only: model.yaml of the arm without payload")


def run_only(args: argparse.Namespace) -> int:
    """Identify a payload and print it with its uncertainty."""
    from dataclasses import replace

    from robot_ident.bags import read_for
    from robot_ident.cli.processing import AS_DECLARED
    from robot_ident.estimation.effort_checks import contradictions
    from robot_ident.estimation.held_body import part_of
    from robot_ident.estimation.payload import bare, identify_payload
    from robot_ident.files import refuse_existing, refuse_twice, write_text
    from robot_ident.model.model_file import read_model
    from robot_ident.recording.checks import refuse_copies
    from robot_ident.recording.measurement import Processing
    from robot_ident.recording.process import process

    if not args.model:
        raise InputError("--only payload: --model model.yaml is needed, the arm without the payload")
    given = [option for option in _OF_THE_MODEL if getattr(args, option[2:].replace("-", "_"))]
    if given:
        raise InputError(f"--only payload does not go with {', '.join(given)}: the model says so")
    if args.output:
        refuse_existing(args.output, force=args.force)
    refuse_twice(args.bags)
    model = read_model(args.model)
    used = Processing(**dict(model.processing)) if model.processing else Processing()
    processing = replace(used, base_frequency=args.base_frequency, periodic=False if args.not_periodic else None)
    recordings = [read_for(bag, model.robot, topic=args.topic) for bag in args.bags]
    stated = {recording.conditions.payload for recording in recordings}
    if len(stated) > 1:
        raise InputError(f"{', '.join(args.bags)}: their conditions state different payloads; one at a time")
    bared = [replace(recording, conditions=bare(recording.conditions)) for recording in recordings]
    measurements = [process(recording, model.robot, processing) for recording in bared]
    refuse_copies(measurements)
    doubts = contradictions(measurements, model.robot, as_declared=args.as_declared, otherwise=AS_DECLARED, loaded=True)
    part = part_of([(recording.source, recording.conditions) for recording in recordings])
    found = identify_payload(measurements, model, next(iter(stated)), part)
    found = replace(found, notes=(*doubts, *(n for m in measurements for n in m.notes), *found.notes))
    if _empty(found):
        found = replace(found, notes=(*found.notes, f"{_empty(found)}: no payload to write"))
    if args.output:
        write_text(args.output, _conditions(found), force=args.force)
    if args.json:
        print_json(found.to_dict())
        return 0
    _print(found, args.output)
    return 0


def _conditions(found: PayloadFit) -> str:
    """Return the payload as the conditions of a recording, none where the data tell of nothing in the hand."""
    from robot_ident.recording.conditions import Conditions, KnownPayload

    empty = _empty(found)
    if empty:
        return Conditions(note=empty).text()
    known = found.body.known
    note = "payload identified; its own inertia is left out"
    return Conditions(KnownPayload(known.mass, known.centre), note=note).text()


def _empty(found: PayloadFit) -> str:
    """Return in words that a mass can't be told from zero, nothing where it can."""
    if found.body.mass > 0 and found.body.to_dict()["mass_interval"][0] > 0:
        return ""
    return f"nothing in the hand that the data tell ({found.body.mass:.2g} +- {found.body.mass_std:.2g} kg)"


def body_table(body: Mapping[str, Any]) -> str:
    """Return mass, centre and inertia of a payload with their standard deviations."""
    from robot_ident.estimation.body import NOTHING

    def row(name: str, value: float, std: float, unit: str, what: str) -> tuple[str, str, str, str]:
        if what in body["given"]:
            return name, f"{value:.5f}", "given", unit
        return (name, f"{value:.5f}", f"{std:.5f}", unit) if std < NOTHING else (name, "not told", "", unit)

    centre = zip("xyz", body["centre"], body["centre_std"], strict=True)
    moments = zip(_MOMENTS, body["inertia"], body["inertia_std"], strict=True)
    listed = [row("mass", body["mass"], body["mass_std"], "kg", "mass")]
    listed += [row(f"centre {axis}", value, std, "m", "centre") for axis, value, std in centre]
    listed += [row(name, value, std, "kg m^2", "inertia") for name, value, std in moments]
    return table(("payload", "value", "sigma", "unit"), listed)


def _print(found: PayloadFit, output: str | None) -> None:
    for note in found.notes:
        tell(note)
    say(body_table(found.to_dict()))
    say("centre in the end effector's frame, moments of inertia about it along its axes")
    if found.stated is not None:
        centre = ", ".join(f"{c:g}" for c in found.stated.centre)
        say(f"the conditions state {found.stated.mass:g} kg at [{centre}] m")
    say()
    joints = [(joint, rms, found.noise_rms[joint]) for joint, rms in found.residual_rms.items()]
    say(table(("joint", "residual rms", "noise rms"), joints))
    if output:
        say(f"written: {output}")
