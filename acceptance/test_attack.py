"""What the command line answers to recordings, robots and files that would give a wrong number: refused, named, silent.

Run by `make acceptance PARTS=attack`; about ten minutes. `refused`: exit code 2 and one line. `named`: a line that the
intact input doesn't get. `silent`: a figure moved by more than `SIGMAS` standard deviations and nothing was said of it.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.cli.main import main
from robot_ident.model.model_file import read_model

SEED = int(os.environ.get("ROBOT_IDENT_ATTACK_SEED", "1"))
MUTATIONS = int(os.environ.get("ROBOT_IDENT_MUTATIONS", "300"))
SIGMAS = 10.0
ROBOTS = Path(__file__).resolve().parents[1] / "config/robots"
UNDECIDABLE = {"position offset"}
"""A joint whose zero is off obeys the same equations with other parameters, which predict its torque as well."""
Arrays = dict[str, Any]


@dataclass
class Bench:
    """A recording, its robot, its trajectory, and what they give when nothing is wrong."""

    folder: Path
    arrays: Arrays
    other: Arrays
    told: set[str] = field(default_factory=set)
    values: Any = None
    std: Any = None


def run(*words: object) -> tuple[int, str, str]:
    """Run a command in this process; return exit code, standard output and errors."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main([str(word) for word in words])
        except SystemExit as ended:
            code = int(ended.code or 0)
    return code, out.getvalue(), err.getvalue()


def kinds(text: str) -> set[str]:
    """Return the lines of a text without their numbers and names of files."""
    return {re.sub(r"[-+0-9.]+(e[-+]?\d+)?|\S+\.npz", "#", line) for line in text.splitlines()}


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    folder = tmp_path_factory.mktemp("attack")
    golden = Path(__file__).resolve().parents[1] / "test/golden/inputs"
    for number in (1, 2):
        shutil.copy(golden / f"excitation_{number}.yaml", folder)
        made = folder / f"{number}.npz"
        assert (
            run("simulate", golden / f"excitation_{number}.yaml", "--periods", 10, "--seed", 70 + number, "-o", made)[0]
            == 0
        )
    for name in ("kuka_ir361.yaml", "kuka_ir361.urdf"):
        shutil.copy(ROBOTS / name, folder)
    found = Bench(folder, dict(np.load(folder / "1.npz")), dict(np.load(folder / "2.npz")))
    code, _, err = run(
        "identify", folder / "1.npz", "--robot", folder / "kuka_ir361.yaml", "-o", folder / "intact.yaml"
    )
    assert code == 0
    model = read_model(folder / "intact.yaml")
    found.told, found.values, found.std = kinds(err), model.values, model.std
    return found


@dataclass(frozen=True)
class Answer:
    """What `identify` and `diagnose` said to an input."""

    identify: str
    moved: float
    diagnose: str
    line: str


def ask(bench: Bench, bag: Path, robot: Path, *options: object) -> Answer:
    model = bench.folder / "model.yaml"
    model.unlink(missing_ok=True)
    code, _, err = run("identify", bag, "--robot", robot, "-o", model, *options)
    assert "Traceback" not in err and code in (0, 2), err
    if code == 2:
        lines = err.splitlines()
        assert len([line for line in lines if line.startswith("robot_ident ")]) == 1, err
        assert not model.exists()
        return Answer("refused", 0.0, "", lines[-1])
    found = read_model(model)
    moved = float(np.max(np.abs(found.values - bench.values) / np.hypot(bench.std, found.std)))
    new = [line for line in err.splitlines() if not kinds(line) <= bench.told]
    code, out, err = run("diagnose", model, bag)
    assert "Traceback" not in err and code in (0, 2), err
    verdict = out.splitlines()[0] if code == 0 else err.splitlines()[-1]
    return Answer("named" if new else "silent", moved, verdict, new[0] if new else "")


# -- the table


def spoiled(change: Callable[[Arrays, Arrays], Arrays]) -> Callable[[Bench], tuple[Path, Path, tuple[object, ...]]]:
    """Return what writes a spoiled recording and gives it with the robot."""

    def make(bench: Bench) -> tuple[Path, Path, tuple[object, ...]]:
        bag = bench.folder / "spoiled.npz"
        np.savez(bag, **change(bench.arrays, bench.other))
        return bag, bench.folder / "kuka_ir361.yaml", ()

    return make


def robot_with(old: str, new: str) -> Callable[[Bench], tuple[Path, Path, tuple[object, ...]]]:
    """Return what writes the robot with one word changed, in its YAML or its URDF."""

    def make(bench: Bench) -> tuple[Path, Path, tuple[object, ...]]:
        place = bench.folder / "other"
        place.mkdir(exist_ok=True)
        for name in ("kuka_ir361.yaml", "kuka_ir361.urdf"):
            (place / name).write_text((bench.folder / name).read_text().replace(old, new))
        return bench.folder / "1.npz", place / "kuka_ir361.yaml", ()

    return make


def _noise(a: Arrays, _: Arrays) -> Arrays:
    return {**a, "tau": np.random.default_rng(SEED).normal(size=a["tau"].shape) * a["tau"].std(axis=0)}


def _columns(a: Arrays, order: list[int], *keys: str) -> Arrays:
    return {**a, **{key: a[key][:, order] for key in keys}}


def _finer(a: Arrays, _: Arrays) -> Arrays:
    t = np.arange(a["t"][0], a["t"][-1], 1 / 4000)
    finer = {key: np.column_stack([np.interp(t, a["t"], x) for x in a[key].T]) for key in ("q", "tau")}
    return {"t": t, "names": a["names"], **finer}


def _two(a: Arrays, b: Arrays) -> Arrays:
    n = min(len(a["t"]), len(b["t"]))
    t = np.concatenate([a["t"][:n], a["t"][:n] + 0.003])
    order = np.argsort(t)
    both = {key: np.concatenate([a[key][:n], b[key][:n]])[order] for key in ("q", "tau")}
    return {"t": t[order], "names": a["names"], **both}


TABLE: dict[str, Callable[[Bench], tuple[Path, Path, tuple[object, ...]]]] = {
    "clock 10 % slow": spoiled(lambda a, _: {**a, "t": 0.9 * a["t"]}),
    "clock 10 % fast": spoiled(lambda a, _: {**a, "t": 1.1 * a["t"]}),
    "gravity upside down": robot_with("-9.81", "9.81"),
    "gravity of the moon": robot_with("-9.81", "-1.62"),
    "noise as torque": spoiled(_noise),
    "absolute value of the effort": spoiled(lambda a, _: {**a, "tau": np.abs(a["tau"])}),
    "efforts of 2 and 3 exchanged": spoiled(lambda a, _: _columns(a, [0, 2, 1], "tau")),
    "effort of 3 also under 2": spoiled(lambda a, _: _columns(a, [0, 2, 2], "tau")),
    "positions of 2 and 3 exchanged": spoiled(lambda a, _: _columns(a, [0, 2, 1], "q")),
    "a length in mm": robot_with('xyz="0.480 0 0"', 'xyz="480 0 0"'),
    "a centre of mass in mm": robot_with('xyz="-0.2431 -0.0222 0.0227"', 'xyz="-243.1 -22.2 22.7"'),
    "6 columns without names": spoiled(
        lambda a, _: {"t": a["t"], "q": np.hstack([a["q"]] * 2), "tau": np.hstack([a["tau"]] * 2)}
    ),
    "another motion's trajectory": lambda b: (
        b.folder / "1.npz",
        b.folder / "kuka_ir361.yaml",
        ("--trajectory", b.folder / "excitation_2.yaml"),
    ),
    "interpolated to 4 kHz": spoiled(_finer),
    "two robots on one topic": spoiled(_two),
    "effort of another run": spoiled(lambda a, b: {**a, "tau": b["tau"]}),
    "effort in N mm": spoiled(lambda a, _: {**a, "tau": 1000.0 * a["tau"]}),
    "effort turned round": spoiled(lambda a, _: {**a, "tau": -a["tau"]}),
    "positions in degrees": spoiled(lambda a, _: {**a, "q": np.rad2deg(a["q"])}),
    "times in ms": spoiled(lambda a, _: {**a, "t": 1000.0 * a["t"]}),
}


def test_table(bench: Bench) -> None:
    silent = []
    print(f"\n{'input':<34} {'identify':<9} {'moved':>8}  said")
    for name, make in TABLE.items():
        bag, robot, options = make(bench)
        answer = ask(bench, bag, robot, *options)
        print(f"{name:<34} {answer.identify:<9} {answer.moved:8.1f}  {(answer.line or answer.diagnose)[:150]}")
        if answer.identify == "silent" and answer.moved > SIGMAS:
            silent.append(name)
    assert silent == []


def test_every_second_row_beside_the_recording(bench: Bench) -> None:
    half = bench.folder / "half.npz"
    np.savez(half, **{key: x if key == "names" else x[::2] for key, x in bench.arrays.items()})
    code, _, err = run("identify", bench.folder / "1.npz", half)
    assert code == 2 and "holds the samples of" in err


# -- mutations


def mutate(random: np.random.Generator, a: Arrays, b: Arrays) -> tuple[str, Arrays]:
    """Return one mutation of a recording, and what it is."""
    joint, n = int(random.integers(a["q"].shape[1])), len(a["t"])
    q, tau = np.array(a["q"]), np.array(a["tau"])
    size = float(np.exp(random.uniform(np.log(0.02), np.log(50.0))))
    first = int(random.integers(n // 2))
    rows = slice(first, first + int(random.integers(10, n // 3)))
    kind = str(
        random.choice(
            [
                "gain of one effort", "gain of all efforts", "sign of one effort", "scale of one position", "clock",
                "efforts exchanged", "positions exchanged", "effort of another run", "rows lost", "rows twice",
                "a piece of another run", "effort frozen", "position frozen", "effort late", "effort clipped",
                "effort coarse", "position coarse", "absolute effort", "noise in a piece", "spikes", "position offset",
            ]
        )
    )  # fmt: skip
    out = dict(a)
    out.pop("dq", None)
    if kind == "gain of one effort":
        tau[:, joint] *= size
    elif kind == "gain of all efforts":
        tau *= size
    elif kind == "sign of one effort":
        tau[:, joint] *= -1.0
    elif kind == "scale of one position":
        q[:, joint] *= size
    elif kind == "clock":
        out["t"] = a["t"] * size
    elif kind == "efforts exchanged":
        tau = tau[:, random.permutation(tau.shape[1])]
    elif kind == "positions exchanged":
        q = q[:, random.permutation(q.shape[1])]
    elif kind == "effort of another run":
        tau[:, joint] = b["tau"][:n, joint]
    elif kind == "rows lost":
        keep = random.random(n) > random.uniform(0.01, 0.9)
        return kind, {key: x if key == "names" else x[keep] for key, x in out.items()}
    elif kind == "rows twice":
        again = np.sort(np.concatenate([np.arange(n), random.integers(0, n, n // 10)]))
        return kind, {key: x if key == "names" else x[again] for key, x in out.items()}
    elif kind == "a piece of another run":
        q[rows], tau[rows] = b["q"][rows], b["tau"][rows]
    elif kind == "effort frozen":
        tau[rows, joint] = tau[first, joint]
    elif kind == "position frozen":
        q[rows, joint] = q[first, joint]
    elif kind == "effort late":
        tau = np.roll(tau, int(random.integers(1, 200)), axis=0)
    elif kind == "effort clipped":
        limit = random.uniform(0.1, 0.9) * np.abs(tau[:, joint]).max()
        tau[:, joint] = np.clip(tau[:, joint], -limit, limit)
    elif kind == "effort coarse":
        step = random.uniform(0.05, 1.0) * np.abs(tau[:, joint]).max()
        tau[:, joint] = np.round(tau[:, joint] / step) * step
    elif kind == "position coarse":
        step = float(np.exp(random.uniform(np.log(1e-4), np.log(0.3))))
        q[:, joint] = np.round(q[:, joint] / step) * step
    elif kind == "absolute effort":
        tau[:, joint] = np.abs(tau[:, joint])
    elif kind == "noise in a piece":
        tau[rows, joint] = random.normal(0.0, tau[:, joint].std(), len(tau[rows]))
    elif kind == "spikes":
        some = random.integers(0, n, n // 50)
        tau[some, joint] += random.normal(0.0, 1e4, len(some))
    else:
        q[:, joint] += random.uniform(-1.0, 1.0)
    return kind, {**out, "q": q, "tau": tau}


def test_mutations(bench: Bench) -> None:
    """No traceback, and few figures far off without a word; those are printed with their seeds."""
    answers: Counter[tuple[str, str]] = Counter()
    silent = []
    for seed in range(SEED * 1000, SEED * 1000 + MUTATIONS):
        kind, arrays = mutate(np.random.default_rng(seed), bench.arrays, bench.other)
        bag = bench.folder / "mutated.npz"
        np.savez(bag, **arrays)
        answer = ask(bench, bag, bench.folder / "kuka_ir361.yaml")
        wrong = answer.identify == "silent" and answer.moved > SIGMAS
        answers[kind, "silent and wrong" if wrong else answer.identify] += 1
        if wrong:
            silent.append((seed, kind, round(answer.moved), answer.diagnose[:110]))
    print(f"\n{'mutation':<26} {'refused':>8} {'named':>8} {'silent':>8} {'silent and wrong':>17}")
    for kind in sorted({kind for kind, _ in answers}):
        print(
            f"{kind:<26}", *(f"{answers[kind, how]:>8}" for how in ("refused", "named", "silent", "silent and wrong"))
        )
    print("\n".join(map(json.dumps, silent)))
    told = [one for one in silent if one[1] not in UNDECIDABLE]
    assert len(told) <= MUTATIONS // 50, told
