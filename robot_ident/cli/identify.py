"""`robot_ident identify`; `--only payload`: what a known arm carries."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from robot_ident.bags import read_for
from robot_ident.cli.options import given
from robot_ident.cli.output import print_json, say, say_written, table, tell
from robot_ident.cli.values import bags_of, given_angles, processing_of, refuse_default_robot
from robot_ident.effects import refuse_unseen
from robot_ident.errors import InputError
from robot_ident.estimation.effort_checks import contradictions
from robot_ident.estimation.identify import with_base
from robot_ident.estimation.payload import NOTHING, PayloadFit, bare, identify_payload, part_of
from robot_ident.files import refuse_twice, write_text
from robot_ident.model.model import Fit, Model
from robot_ident.model.model_file import read_model, write_model
from robot_ident.model.structure import Structure
from robot_ident.provenance import provenance
from robot_ident.recording.checks import refuse_copies, refuse_same_rows
from robot_ident.recording.conditions import Conditions, KnownPayload
from robot_ident.recording.measurement import Processing
from robot_ident.recording.process import process
from robot_ident.robot import Robot, load_robot
from robot_ident.workflow.fitting import at_its_speed, held_in_recordings, held_note

_OTHERWISE = ", or continue with --as-declared"
_MOMENTS = "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"

_OF_THE_MODEL = (
    "--effect --physical --joints --hold --trajectory --low-pass --derivative-bandwidth --minimum-speed --anti-alias"
)
"""Options of `identify` that would have no effect with `--only payload`."""


def run_only(args: argparse.Namespace) -> None:
    """Identify a payload and print it with its uncertainty."""
    if not args.model:
        raise InputError("--only payload: --model model.yaml is needed, the arm without the payload")
    told = given(args, _OF_THE_MODEL)
    if told:
        raise InputError(f"--only payload does not go with {told}: the model says so")
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
    doubts = contradictions(measurements, model.robot, as_declared=args.as_declared, otherwise=_OTHERWISE, loaded=True)
    part = part_of([(recording.source, recording.conditions) for recording in recordings])
    found = identify_payload(measurements, model, next(iter(stated)), part)
    found = replace(found, notes=model.leading((*doubts, *(n for m in measurements for n in m.notes), *found.notes)))
    if _empty(found):
        found = replace(found, notes=(*found.notes, f"{_empty(found)}: no payload to write"))
    if args.output:
        write_text(args.output, _conditions(found), force=args.force)
    if args.json:
        print_json(found.to_dict())
        return
    _print(found, args.output)


def _conditions(found: PayloadFit) -> str:
    """Return the payload as the conditions of a recording, none where the data tell of nothing in the hand."""
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
    tell(*found.notes)
    say(body_table(found.to_dict()))
    say("centre in the end effector's frame, moments of inertia about it along its axes")
    if found.stated is not None:
        centre = ", ".join(f"{c:g}" for c in found.stated.centre)
        say(f"the conditions state {found.stated.mass:g} kg at [{centre}] m")
    joints = [(joint, rms, found.noise_rms[joint]) for joint, rms in found.residual_rms.items()]
    say("", table(("joint", "residual rms", "noise rms"), joints))
    say_written(output)


def run(args: argparse.Namespace) -> None:
    """Identify and print the parameters with their uncertainty."""
    args.bags = bags_of(args)
    if args.only:
        run_only(args)
        return
    if args.model:
        raise InputError("--model: goes with --only payload; identify estimates the whole arm anew")
    whole = load_robot(args.robot)
    refuse_twice(args.bags)
    refuse_unseen(args.effect, whole)
    recordings = [read_for(bag, whole, topic=args.topic) for bag in args.bags]
    refuse_default_robot(args.robot, whole.joints, recordings)
    refuse_same_rows(recordings)
    robot, recordings, held = held_in_recordings(whole, recordings, args.joints, given_angles(args, whole))
    robot = robot if args.base is None else replace(robot, base=args.base)
    recordings, processing = at_its_speed(args.trajectory or [], recordings, processing_of(args, robot, played=whole))
    structure = Structure.build(robot, args.effect)
    measurements = [process(recording, robot, processing) for recording in recordings]
    refuse_copies(measurements)
    doubts = contradictions(measurements, robot, as_declared=args.as_declared, otherwise=_OTHERWISE)
    chosen = with_base(recordings, measurements, structure, processing)
    model = chosen.model(estimator=args.estimator, physical=args.physical, notes=(*held_note(whole, held), *doubts))
    options = {
        "trajectory": args.trajectory if len(args.trajectory or ()) > 1 else (args.trajectory or [None])[0],
        "topic": args.topic,
        "effects": args.effect or None,
        "physical": args.physical or None,
        "base": args.base,
        "held": held or None,
    }
    model = replace(model, provenance=provenance(args.bags, options))
    if args.output:
        write_model(model, args.output, force=args.force)
    if args.json:
        print_json(model.to_dict())
        return
    tell(*model.notes)
    quality = f"condition number {model.condition_number:.4g}, log10 det of the covariance"
    quality += f" {model.log10_det_covariance:.2f}"
    say(parameter_table(model), "", fit_table(model.robot, model.residual), "", quality)
    if model.chi_square is not None and model.dof:
        say(f"chi-square per degree of freedom {model.chi_square / model.dof:.4f} ({model.dof:.0f} degrees of freedom)")
    for text in payload_tables(model):
        say("", text)
    for one in model.per_period:
        say(
            f"{one['source']}: scatter / predicted sigma = {one['scatter_over_sigma']:.2f} over"
            f" {one['periods']} periods (expect 1)"
        )
    if model.days is not None:
        say(_days(model.days))
    say_written(args.output)


def payload_tables(model: Model) -> list[str]:
    """Return a table for every payload that was found with the arm."""
    return [
        f"payload {one['name']}".rstrip() + f" of {', '.join(one['recordings'])}\n" + body_table(one)
        for one in model.payloads
    ]


def _days(days: Mapping[str, Any]) -> str:
    """Return what the intervals hold for."""
    if days["scatter_over_sigma"] is None:
        return "intervals: exclude day-to-day variation (record on three days or more to estimate it)"
    ratio = days["scatter_over_sigma"]
    return f"intervals: scatter / predicted sigma = {ratio:.2f} over {len(days['days'])} days (expect 1)"


def parameter_table(model: Model) -> str:
    """Return the parameters with their standard deviations."""
    rows = [
        (p.name, f"{value:.4f}", "at its bound", p.unit, "", p.meaning)
        if at_bound
        else (p.name, *to_the_digit(value, std), p.unit, _percent(value, std), p.meaning)
        for p, value, std, at_bound in zip(model.parameters, model.values, model.std, model.at_bound, strict=True)
    ]
    return table(("parameter", "value", "sigma", "unit", "sigma/value", "meaning"), rows)


def to_the_digit(value: float, std: float) -> tuple[str, str]:
    """Return both with two digits of the standard deviation at least: wrists have inertias of 1e-4 kg m^2."""
    places = max(4, 1 - math.floor(math.log10(std))) if 0 < std < math.inf else 4
    return (f"{value:.{places}f}", f"{std:.{places}f}") if places <= 8 else (f"{value:.6g}", f"{std:.2g}")


def _percent(value: float, std: float) -> str:
    share = 100.0 * std / abs(value) if value else float("inf")
    return f"{share:.1f} %" if share < 1000 else "not known"


def fit_table(robot: Robot, residual: Mapping[str, Fit]) -> str:
    """Return the residual of every joint beside the noise."""
    rows = [
        (
            joint,
            fit.rms,
            None if fit.noise_variance is None else fit.noise_variance**0.5,
            fit.mse / fit.noise_variance if fit.noise_variance else None,
            None if fit.relative is None else f"{100 * fit.relative:.2f} %",
            robot.torque_unit(robot.joint_index(joint)),
        )
        for joint, fit in residual.items()
    ]
    return table(("joint", "residual rms", "noise rms", "mse/noise", "relative", "unit"), rows)
