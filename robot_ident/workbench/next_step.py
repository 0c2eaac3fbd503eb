"""The words on the screen: where one stands, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from robot_ident.report.wording import short
from robot_ident.workbench.jobs import Job
from robot_ident.workbench.view import CANDIDATE, Overlay, View, most

Stage = Literal["compare", "see", "learn", "add", "watch"]
STAGES: dict[Stage, str] = {
    "compare": "model vs. measurement",
    "see": "where it fails",
    "learn": "what is missing",
    "add": "see its fall, and add it",
    "watch": "the error falls",
}


_SAVE = ("Save the model", "save")


@dataclass(frozen=True)
class Next:
    """Where one stands in the loop, what that means, and the step that follows: its button's text and what it does."""

    stage: Stage
    words: str
    button: str | None = None
    do: str | None = None
    label: str = ""


def next_step(view: View | None, job: Job, overlays: list[Overlay]) -> Next:
    """Return what to do next."""
    if view is None:
        if job.state in ("failed", "cancelled"):
            words = "These recordings could not be opened. Choose others, or try again."
            return Next("compare", words, "Try again", "open")
        return Next("compare", "Reading the recordings and holding the model beside them. This is done once.")
    step = _of_step(view, overlays)
    trouble = view.trouble
    return step if trouble is None else replace(step, words=f"{trouble[0].upper()}{trouble[1:]}. {step.words}")


def _of_step(view: View, overlays: list[Overlay]) -> Next:
    chosen = next((o for o in overlays if o.key.startswith(CANDIDATE)), None)
    if chosen is not None:
        return _with_candidate(view, chosen)
    if view.diagnosis is not None:
        return _diagnosed(view, view.diagnosis)
    return _compared(view)


def _compared(view: View) -> Next:
    """The model is held beside the recordings; nobody has asked yet what it lacks."""
    worst, done = view.joints[view.worst], _after_adding(view)
    ask = ("Find what is missing", "diagnose")
    if not view.judged:
        words = (
            f"{done}These recordings do not repeat, so nothing tells their noise. {worst} has the largest residual. The"
            " pictures show where. Next: let every known effect try to predict what it was not fitted to."
        )
        return Next("see", words, *ask)
    if not view.failing and view.unusable:
        words = (
            f"{done}On the recordings that it was fitted to the model leaves noise, but on one kept aside it is"
            " worse than none: “Where it fails” says at which joints, and what to do."
        )
        return Next("see", words, *ask)
    if not view.failing:
        words = f"{done}The model fits: what is left over is noise at every joint. Next: save it."
        return Next("watch", words, *_SAVE)
    of = view.comparison["joints"][view.worst]
    there = view.focus == view.worst
    where = "The pictures show where." if there else f"Press {worst} under “Joints”, and the pictures show where."
    words = (
        f"{done}{worst} is the worst joint: {rms(of['residual_mse'])} {view.unit(view.worst)} rms is left over, where"
        f" noise alone would leave {rms(of['noise_variance'])}. {where} Drag across one of them, or"
        " click a sentence under “Where it fails”, to find the same moments in all. Next: let the computer name the"
        " cause."
    )
    return Next("watch" if done else "see", words, *ask)


def _after_adding(view: View) -> str:
    """Return what the last addition did, empty where there was none."""
    step = view.session.steps[view.number]
    if step.parent is None or step.added is None:
        return ""
    before, after = View(view.session, step.parent).errors, view.errors
    words = f"{step.added} was added: "
    name = most(before["training"], after["training"])
    words += f"{name} went from {_fall(view, name, before['training'], after['training'])}"
    if after["validation"] is not None:
        words += f", on validation from {_fall(view, name, before['validation'], after['validation'])}"
    return words + ". "


def _diagnosed(view: View, found: Mapping[str, Any]) -> Next:
    """A diagnosis is there, and no candidate is looked at."""
    listed = [one for one in found["candidates"] if one["can_be_added"]]
    named = [one for one in listed if one["label"] in found["named"]]
    first = (named or listed or [None])[0]
    look = (f"Show what {first['label']} would do", "look", first["label"]) if first else (None, None, "")
    if found["verdict"] == "adequate":
        rest = found["in_words"].partition(": ")[2]
        return Next("watch", f"Nothing is missing: {rest}. Next: save the model.", *_SAVE)
    if found["verdict"] == "missing" and named:
        are = "is" if len(found["named"]) == 1 else "are"
        words = (
            f"{' and '.join(found['named'])} {are} missing. {named[0]['label']} is {named[0]['meaning']}."
            " Next: see what would remain with it, before you add it."
        )
        return Next("learn", words, *look)
    if found["verdict"] == "missing":
        proofs = [f"{one['label']}: {one['evidence']}" for one in found["candidates"] if one["label"] in found["named"]]
        words = f"Missing, and no torque that could be added: {'; '.join(proofs)}. Next: save the model."
        return Next("learn", words, *_SAVE)
    if found["verdict"] == "unexplained":
        rest = found["unexplained"]
        where = f" What is left of {rest['joint']}: {rest['where']}." if rest else ""
        near = _nearest(view, listed)
        words = f"None of the known effects accounts for the error on motion it was not fitted to.{where}{near}"
        return Next("learn", words, *look)
    words = "These recordings cannot tell what is missing: record another motion, or more periods."
    helping = next((one for one in listed if _helps(one)), None)
    if helping is None:
        nearest = " The nearest are listed; none of them lowers the error on validation." if listed else ""
        return Next("learn", words + nearest)
    label = helping["label"]
    return Next("learn", f"{words} The nearest are listed.", f"Show what {label} would do", "look", label)


def _helps(candidate: Mapping[str, Any]) -> bool:
    """Return whether a candidate lowers the error of its joint on validation, as far as that is known."""
    name = most(candidate["residual_mse_before"], candidate["residual_mse_after"])
    before, after = candidate["validation_mse_before"], candidate["validation_mse_after"]
    return not after or bool(after[name] < before[name])


def _nearest(view: View, listed: list[Mapping[str, Any]]) -> str:
    """Return which candidate comes nearest, where none accounts for the error."""
    if not listed:
        return ""
    one = listed[0]
    kind = "validation" if one["validation_mse_after"] else "residual"
    before, after = one[f"{kind}_mse_before"], one[f"{kind}_mse_after"]
    name = most(before, after)
    on = " on validation" if kind == "validation" else ""
    noise = view.errors["validation_noise" if kind == "validation" else "noise"]
    floor = f" (noise {rms(noise[name])})" if noise and noise[name] is not None else ""
    return (
        f" {one['label']} comes nearest: {name}{on} from {_fall(view, name, before, after)}{floor}. Look at it, or"
        " record a motion that passes there more often."
    )


def _with_candidate(view: View, chosen: Overlay) -> Next:
    """A candidate is laid over the residual."""
    label = chosen.key.removeprefix(CANDIDATE)
    data = view.previews[label]
    name = most(data["before"], data["after"])
    noise = view.errors["noise"][name]
    words = f"The orange residual is what would remain with {label}: {name} from"
    words += f" {_fall(view, name, view.errors['training'], data['after'])}"
    words += "" if noise is None else f" (noise {rms(noise)})"
    if data["validation_after"] is not None:
        after = data["validation_after"]
        words += "; on validation, which nothing is fitted to, from"
        words += f" {_fall(view, name, view.errors['validation'], after)}"
        if after[name] > data["validation_before"][name]:
            return Next("add", f"{words}, which is worse: it is not the cause. Tick another one.")
    there = view.session.find(view.number, label)
    if there is not None:
        return Next("add", f"{words}. It was added already, in step {there}.", f"Go to step {there}", "go", str(there))
    return Next("add", f"{words}. Next: add it, or tick another to see two side by side.", f"Add {label}", "add", label)


def _fall(view: View, name: str, before: Mapping[str, float], after: Mapping[str, float]) -> str:
    """Return `4.34 to 3.17 Nm rms`."""
    return f"{rms(before[name])} to {rms(after[name])} {view.unit(view.joints.index(name))} rms"


def rms(mean_square: float | None) -> str:
    """Return the root of a mean square in three digits."""
    return "unknown" if mean_square is None else short(max(mean_square, 0.0) ** 0.5)
