"""The verdict in one sentence, and the commands that give a report again."""

from __future__ import annotations

import shlex
from dataclasses import replace

import pytest

from robot_ident.cli.main import build_parser
from robot_ident.diagnosis.diagnosis import EVERYWHERE, Diagnosis, Unexplained
from robot_ident.provenance import fingerprint
from robot_ident.report.sections import candidates_section, origin_section
from robot_ident.report.wording import joined, percent, short, verdict, with_sigma
from robot_ident.workflow.findings import Findings


def only_first(findings: Findings, diagnosis: Diagnosis) -> Findings:
    return replace(findings, steps=findings.steps[:1], diagnoses={0: diagnosis})


def test_an_adequate_model_after_an_effect_was_added(findings: Findings) -> None:
    text = verdict(findings)
    assert text.startswith("Adding stribeck@joint_2 takes the error of joint_2 on the validation motion from ")
    assert text.endswith("; the model is adequate: what is left over is noise.")


def test_a_model_that_lacks_something(findings: Findings) -> None:
    before = findings.steps[0].training["joint_2"]
    after = findings.diagnoses[0].missing[0].mse_after["joint_2"]
    assert verdict(only_first(findings, findings.diagnoses[0])) == (
        "The model lacks stribeck@joint_2: adding it is predicted to take the residual of joint_2 from"
        f" {short(before.rms)} to {short(after**0.5)} Nm rms, where noise alone leaves {short(before.noise)}."
    )


def test_ties_and_remainders_are_said(findings: Findings) -> None:
    found = findings.diagnoses[0]
    tied = replace(found.missing[0], tied_with=("viscous_nonlinear@joint_2",))
    rest = Unexplained("joint_3", {"position": 0.4}, "0.1 < q < 0.2 rad: 50 % of the excess in 5 % of the time")
    other = replace(found, missing=(tied,), unexplained=rest, remaining_rms={"joint_3": 1.25})
    text = verdict(only_first(findings, other))
    assert "(or viscous_nonlinear@joint_2, indistinguishable on these recordings)" in text
    assert "1.25 Nm rms of joint_3 remain unexplained (0.1 < q < 0.2 rad" in text


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("unexplained", "None of the known effects accounts for the error of joint_1, 2 Nm excess rms"),
        ("not_decidable", "These recordings can't tell whether the model lacks anything: too short."),
    ],
)
def test_other_verdicts(findings: Findings, kind: str, words: str) -> None:
    where = Unexplained("joint_1", {}, "t < 1 s")
    found = replace(
        findings.diagnosis, verdict=kind, unexplained=where, remaining_rms={"joint_1": 2.0}, notes=("too short",)
    )
    assert verdict(only_first(findings, found)).startswith(words)


def test_a_model_of_other_values_is_not_called_adequate(findings: Findings) -> None:
    model = findings.last.model
    values = model.values.copy()
    values[0] *= 1.2
    from robot_ident.diagnosis.staircase import staircase

    stale = replace(model, values=values)
    steps = staircase([("old.yaml", stale)], findings.training)
    text = verdict(replace(findings, steps=steps, diagnoses={0: findings.diagnosis}))
    assert "as it stands its values miss joint_1" in text
    assert "identify it again" in text


def test_a_model_whose_values_fit_as_well_as_can_be_is_called_adequate(findings: Findings) -> None:
    """What remains at every joint is no more than a model identified anew would leave."""
    worst, *others = findings.last.comparison.joints
    failing = replace(worst, excess=0.5, misfit=replace(worst.misfit, p_value=1e-9))
    assert failing.fails
    last = replace(findings.last, comparison=replace(findings.last.comparison, joints=(failing, *others)))
    hidden = replace(findings.diagnosis, remaining_rms={worst.name: 0.49}, hidden_in_path=(worst.name,))
    found = replace(findings, steps=(*findings.steps[:-1], last), diagnoses={len(findings.steps) - 1: hidden})
    assert f"the model is adequate: what is left over is noise, and at {worst.name} what noise hides" in verdict(found)
    anew = replace(hidden, remaining_rms={worst.name: 0.2})
    assert "identify it again" in verdict(replace(found, diagnoses={len(findings.steps) - 1: anew}))


def test_what_is_everywhere_sits_nowhere(findings: Findings) -> None:
    everywhere = Unexplained("joint_1", {}, EVERYWHERE)
    found = replace(findings.diagnosis, verdict="unexplained", unexplained=everywhere, remaining_rms={"joint_1": 2.0})
    assert verdict(only_first(findings, found)).endswith("; it is spread over the whole motion.")


def test_commands_can_be_run_again(findings: Findings) -> None:
    commands = origin_section(findings).context["commands"]
    for command in commands[:2]:
        words = shlex.split(command)
        args = build_parser("identify").parse_args(words[1:])
        assert args.bags == [source.path for source in findings.training]
        assert args.output in {step.path for step in findings.steps}
    assert args.effect == ["stribeck@joint_2"]
    model = candidates_section(findings).context["models"][0]
    added = build_parser("add").parse_args(shlex.split(model["named"][0]["add"])[1:])
    assert added.effects == ["stribeck@joint_2"]


def test_a_tie_gives_the_experiment_that_tells(findings: Findings) -> None:
    found = findings.diagnoses[0]
    tied = replace(found.missing[0], tied_with=("viscous_nonlinear@joint_2",))
    context = candidates_section(only_first(findings, replace(found, missing=(tied,)))).context
    told = context["models"][0]["named"][0]["tell"]
    args = build_parser("design").parse_args(shlex.split(told)[1:])
    assert args.tell == ["stribeck@joint_2", "viscous_nonlinear@joint_2"]


def test_recordings_are_told_by_their_hashes(findings: Findings) -> None:
    context = origin_section(findings).context
    for source, line in zip((*findings.training, *findings.validation), context["hashes"], strict=True):
        assert line == f"{fingerprint(source.path)}  {source.path}"
    assert all(model["fitted"].startswith("fitted to the recordings above") for model in context["models"])


def test_figures_in_words() -> None:
    assert [short(v) for v in (None, 0.0, 7.0, 0.1234, 123.4, 12345.0)] == [
        "–",
        "0",
        "7.00",
        "0.123",
        "123",
        "12345",
    ]
    assert [short(v) for v in (9.996, 99.96, 1.2e-4, -3.456e7)] == ["10.0", "100", "0.000120", "-3.46e+07"]
    assert with_sigma(-906.7, 213.0) == "-910 ± 210"
    assert with_sigma(6.294, 0.87) == "6.29 ± 0.87"
    assert with_sigma(27.0, 0.0) == "27"
    assert [joined(w) for w in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == ["", "a", "a and b", "a, b and c"]
    assert percent(0.614) == "61 %"
