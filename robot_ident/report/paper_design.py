"""The paper's page, sections I to IV: the robot, its optimal excitation, the iteration."""

from __future__ import annotations

import numpy as np

from robot_ident.figures import paper as figures
from robot_ident.figures.trajectory import trajectories_figure, trajectory_text
from robot_ident.paper import printed
from robot_ident.paper.excitation import CRITERIA, Excitations, sigma_share
from robot_ident.paper.study import Study
from robot_ident.paper.table_i import TableI
from robot_ident.report.page import Plot, Table
from robot_ident.report.paper_section import NAMES, PaperSection, again, numbers, power
from robot_ident.signals.motion import Array


def robot_section(study: Study, table: TableI) -> PaperSection:
    """Return fig. 1 and Table I."""
    rows = [
        (f"p{k}", name if name != f"p{k}" else "", meaning, f"{shown:g}", f"{value:.2f}", unit)
        for k, (name, meaning, shown, value, unit) in enumerate(
            zip(table.names, printed.MEANING, printed.TABLE_I, table.simulated, table.units, strict=True), 1
        )
    ]
    if table.possible:
        found = (
            "Simulated is the nearest set that a mass distribution can have: p11 = 7.65 and p15 = 7.73, the rest as"
            " printed. It changes the torque by 0.69, 0.31 and 0.31 Nm rms, far below the noise of 5, 5.1 and 3.2 Nm."
        )
    else:
        found = (
            "Simulated is the printed set as it is (--printed-table): the equation of motion holds for it, although no"
            " mass distribution has these moments."
        )
    return PaperSection(
        "1. The robot and its parameters (section IV-A, fig. 1, Table I)",
        "The first three axes of a KUKA IR 361. The model has 21 parameters: 15 combinations of inertial parameters,"
        " p1 to p15, and viscous and Coulomb friction of each joint, p16 to p21.",
        (
            "Frames by modified Denavit-Hartenberg parameters, drawn from the URDF that is simulated. Gravity enters"
            " through p2, p3, p9 and p10 alone.",
            found,
        ),
        (
            Plot(figures.robot_figure(study.robot), figures.robot_text(study.robot), "Fig. 1: x red, y green, z blue."),
            Table(("parameter", "our name", "meaning", "printed", "simulated", "unit"), rows, numeric=(3, 4)),
        ),
        "The printed Table I is not physically possible: Izz3 = 7.63 is less than Ixx3 - Iyy3 = 8.21, and of a body's"
        " three moments of inertia none can exceed the sum of the others. The estimates in the paper are not"
        " constrained, so that noise and friction errors could lead there (identify --physical prevents it).",
        again(study, 1),
    )


def excitation_section(study: Study, found: Excitations) -> PaperSection:
    """Return section IV: figs. 2 and 3, both criteria, Table II, the counts of 200 runs."""
    best, bound = found.optimal["d-optimal"], found.bound
    criteria = []
    for criterion in CRITERIA:
        one, log10 = found.optimal[criterion], found.optimal[criterion].evaluation.log10_det_covariance
        criteria.append(
            (
                f"{NAMES[criterion]}-optimal",
                f"{printed.CONDITION[criterion]:.2f}",
                f"{one.evaluation.condition_number:.2f}",
                f"{printed.DETERMINANT[criterion]:.2e}",
                power(log10),
                f"{bound.efficiency(printed.LOG10_DET[criterion]):.0%}",
                f"{bound.efficiency(log10):.0%}",
            )
        )
    counts = []
    for criterion in CRITERIA:
        for who, runs in (("1500", found.optimal[criterion].runs), ("500", found.optimal[criterion].fewer)):
            low, high = runs.ratio_interval
            counts.append(
                (
                    NAMES[criterion],
                    who,
                    f"{runs.inside_mean} of 21",
                    f"{runs.inside_ratio} of 21",
                    f"{low:.3f} to {high:.3f}",
                    f"{runs.bias_statistic:.1f} ({runs.bias_interval[0]:.1f} to {runs.bias_interval[1]:.1f})",
                    f"{runs.error_statistic:.3f} ({runs.error_interval[0]:.3f} to {runs.error_interval[1]:.3f})",
                )
            )
    fewer = best.fewer
    unbiased = all(
        one.fewer.bias_interval[0] < one.fewer.bias_statistic < one.fewer.bias_interval[1]
        for one in found.optimal.values()
    )
    wider = float(np.mean(fewer.sigma / best.runs.sigma))
    ratio = sigma_share(found, "d-optimal")
    return PaperSection(
        "2. Optimal excitation and its estimates (section IV, figs. 2 and 3, Table II)",
        "Two trajectories, five harmonics of 0.1 Hz, 10,000 iterations of sequential quadratic programming: c1 has"
        " condition number 4.15 and determinant 1.76e-43, c2 5.94 and 2.36e-49. 200 identifications with simulated"
        " noise: the means of 16 of 21 parameters lie within sigma / sqrt(200) of the truth, the standard deviations of"
        " 19 of 21 inside their 90 % interval. With 500 samples instead of 1500 the estimates are said to be biased.",
        (
            f"The c2-optimal trajectory reaches a determinant of {power(best.evaluation.log10_det_covariance)}: sigma"
            f" is {float(np.exp(np.mean(np.log(ratio)))):.2f} times the printed one in the geometric mean"
            f" ({ratio.min():.2f} to {ratio.max():.2f}). No trajectory within the limits gets below"
            f" {power(bound.log10_det_covariance)}; per parameter it tells at least"
            f" {bound.efficiency(best.evaluation.log10_det_covariance):.0%} of what any could (the paper's"
            f" {bound.efficiency(printed.LOG10_DET['d-optimal']):.0%}).",
            "The exact tests of the last two columns use all parameters with their covariance: n D' C^-1 D of the mean"
            " errors D is chi-square with 21 degrees of freedom, the mean of e' C^-1 e / 21 over the runs is 1.",
            "With every third sample, 500, the estimates are"
            + (" not biased" if unbiased else " outside the interval of an unbiased estimator")
            + f" either; sigma grows by {wider:.2f}, the root of 3. Least squares with exact regressors is unbiased for"
            " any number of samples.",
        ),
        (
            Plot(
                trajectories_figure(
                    {
                        "c1 (fig. 2)": found.optimal["condition"].excitation,
                        "c2 (fig. 3)": best.excitation,
                    },
                    found.robot,
                ),
                f"c1: {trajectory_text(found.optimal['condition'].excitation, found.robot)}"
                f" c2: {trajectory_text(best.excitation, found.robot)}",
                "One period. Dashed: limits of the joint of that colour, grey where joints share one.",
            ),
            Table(
                (
                    "trajectory",
                    "condition, paper",
                    "here",
                    "determinant, paper",
                    "here",
                    "D-efficiency at least, paper",
                    "here",
                ),
                criteria,
                numeric=(1, 2, 3, 4, 5, 6),
            ),
            Plot(figures.sigmas_figure(found), _sigma_text(ratio), "Table II: predicted standard deviations."),
            _table_ii(found),
            Table(
                (
                    "trajectory",
                    "samples",
                    "means inside (paper: 16)",
                    "ratios inside (paper: 19)",
                    "interval of the ratio",
                    "bias (99.8 % interval)",
                    "spread (3 sigma)",
                ),
                counts,
                numeric=(1, 2, 3),
            ),
        ),
        "Better trajectories by a multi-start search of a smooth problem with exact derivatives; the estimates behave"
        " as the paper finds. Two slips: the interval of the ratio of standard deviations is .919 to 1.084 by the"
        " paper's formula (.923 to 1.089 are printed), and the bias with 500 samples can't be, unless the regressor is"
        " noisy.",
        again(
            study,
            2,
            "robot_ident design --criterion condition --bound -o c1.yaml",
            "robot_ident design --bound -o c2.yaml",
            "robot_ident montecarlo c2.yaml --runs 200",
        ),
    )


def _sigma_text(ratio: Array) -> str:
    return (
        f"Standard deviations of 21 parameters; of the c2-optimal trajectory {int(np.sum(ratio < 1))} are smaller than"
        f" the printed ones, the ratio runs from {ratio.min():.2f} to {ratio.max():.2f}."
    )


def _table_ii(found: Excitations) -> Table:
    one, two = (found.optimal[criterion].runs for criterion in CRITERIA)
    rows = []
    for k in range(len(found.names)):
        digits = max(4, 1 - int(np.floor(np.log10(two.sigma[k]))))
        rows.append(
            (
                f"p{k + 1}",
                *(
                    f"{value:.{digits}f}"
                    for value in (
                        two.true[k],
                        printed.SIGMA["condition"][k],
                        one.sigma[k],
                        printed.SIGMA["d-optimal"][k],
                        two.sigma[k],
                        found.sigma_cr[k],
                        two.mean[k],
                        two.sample_sigma[k],
                    )
                ),
            )
        )
    header = (
        "parameter",
        "true",
        "sigma c1, paper",
        "here",
        "sigma c2, paper",
        "here",
        "Cramér-Rao, c2",
        "200 runs, c2: mean",
        "sigma",
    )
    return Table(header, rows, numeric=tuple(range(1, 9)))


def iteration_section(study: Study) -> PaperSection:
    """Return section III-B, from measurement to measurement."""
    found, bound = study.redesign, study.excitations.bound
    rows = [
        (
            str(number),
            {"condition": "c1", "crlb": "Cramér-Rao bound"}.get(one.excitation.criterion or "", ""),
            f"{one.log10_det_bound:.2f}",
            f"{one.model.condition_number:.2f}",
            f"{-100 * one.fall:+.1f} %" if one.fall else "",
        )
        for number, one in enumerate(found.rounds, 1)
    ]
    ended = (
        f"After {len(found.rounds)} measurements the next trajectory would lower the mean sigma by"
        f" {100 * max(0.0, found.next_fall):.1f} %, less than the 2 % of the stop rule."
        if found.converged
        else f"After {len(found.rounds)} measurements sigma still falls by {100 * found.next_fall:.1f} %."
    )
    gain = float(np.max(np.abs(study.excitations.sigma_cr / study.excitations.optimal["d-optimal"].runs.sigma - 1.0)))
    return PaperSection(
        "3. Design by the Cramér-Rao bound, iterated (section III-B)",
        "With noise on positions the bound depends on the parameters: design by c1, measure, estimate by maximum"
        " likelihood, minimise the bound at that estimate, measure again, until nothing changes. No figures are given.",
        (
            ended,
            f"Position noise of 1e-5 rad changes the standard deviations of Table II by at most {gain:.0e} of"
            " themselves: the bound is that of c2, and the second trajectory is c2-optimal at once. On the real robot,"
            " too, the paper found that it changed nothing.",
        ),
        (
            Plot(
                figures.rounds_figure(found, bound.log10_det_covariance),
                "log10 of the determinant of the bound:"
                f" {numbers((one.log10_det_bound for one in found.rounds), '.2f')}.",
            ),
            Table(
                ("measurement", "designed by", "log10 det of the bound", "condition number", "sigma, mean"),
                rows,
                numeric=(0, 2, 3, 4),
            ),
        ),
        "Eq. 6 as printed is a product of gradients, zero at the optimum; used here is F = sum J' W J, and for theta"
        " (F_tt - F_td F_dd^-1 F_dt)^-1.",
        again(study, 3, "robot_ident design --criterion crlb --iterate -o last.yaml"),
    )
