"""The paper's page, sections I to IV: the robot, its optimal excitation, the iteration."""

from __future__ import annotations

import numpy as np

from robot_ident.figures import paper as figures
from robot_ident.figures.trajectory import trajectories_figure, trajectory_text
from robot_ident.limits.certifier import certify
from robot_ident.paper import printed
from robot_ident.paper.excitation import CRITERIA, Excitations, sigma_share
from robot_ident.paper.robots import table_i
from robot_ident.paper.study import Study
from robot_ident.report.page import Plot, Section, Table
from robot_ident.report.paper_section import NAMES, again, numbers, paper_section, power


def robot_section(study: Study) -> Section:
    """Return fig. 1 and Table I."""
    table = table_i(study.robot)
    rows = [
        (f"p{k}", name if name != f"p{k}" else "", meaning, f"{shown:g}", f"{value:.2f}", unit)
        for k, (name, meaning, shown, value, unit) in enumerate(
            zip(table.names, printed.MEANING, printed.TABLE_I, table.simulated, table.units, strict=True), 1
        )
    ]
    if table.possible:
        found = (
            "Simulated is a set near it that a mass distribution can have: p15 >= p11, with room for the products of"
            " inertia and the first moments, which p11 = 7.65 and p15 = 7.73 give; the rest is as printed to 0.002. It"
            " changes the torque by 0.69, 0.31 and 0.31 Nm rms, below the noise of 5.0, 5.1 and 3.2 Nm."
        )
    else:
        found = (
            "Simulated is the printed set as it is (--printed-table): the equation of motion holds for it, although no"
            " mass distribution has these moments."
        )
    return paper_section(
        "1. The robot and its parameters (section IV-A, fig. 1, Table I)",
        "The first three axes of a KUKA IR 361. The torque is linear in the parameters, eq. (1): tau = Phi(q, dq, ddq)"
        " theta. theta has 21 of them: 15 combinations of inertial parameters, p1 to p15, and viscous and Coulomb"
        " friction of each joint, p16 to p21.",
        (
            "Frames by modified Denavit-Hartenberg parameters, drawn from the URDF that is simulated: 1.020 m to axis"
            " 2, upper arm l = 0.480 m, 0.765 m from axis 3 to the flange. Gravity enters through p2, p3, p9 and p10"
            " alone: potential energy g (p2 cos q2 - p3 sin q2 + p9 sin q23 + p10 cos q23), q23 = q2 + q3.",
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


def excitation_section(study: Study) -> Section:
    """Return section IV: figs. 2 and 3, both criteria, Table II, the counts of 200 runs."""
    found = study.excitations
    best, other, bound = found.optimal["d-optimal"], found.optimal["condition"], found.bound
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
    quantities = ("condition", "determinant", "D-efficiency at least")
    fewer = best.fewer
    unbiased = all(
        one.fewer.bias_interval[0] < one.fewer.bias_statistic < one.fewer.bias_interval[1]
        for one in found.optimal.values()
    )
    wider = float(np.mean(fewer.sigma / best.runs.sigma))
    ratio, of_c1 = sigma_share(found, "d-optimal"), sigma_share(found, "condition")
    return paper_section(
        "2. Optimal excitation and its estimates (section IV, figs. 2 and 3, Table II)",
        "Trajectories are finite Fourier series, eq. (11): q(t) = q0 + sum_l a_l / (w l) sin(w l t) - b_l / (w l) cos(w"
        " l t), l = 1 to 5, w / 2 pi = 0.1 Hz. Periodic motions are averaged, tell their noise without a model,"
        " excite a band of choice, and their velocities and accelerations follow exactly from the lines of the"
        " spectrum. The rows Phi and the measured torques of all samples are stacked in F"
        " and b, eq. (8); the estimate is theta = (F' S^-1 F)^-1 F' S^-1 b, S the covariance of the noise, eq. (7)"
        " (without weights: F+ b, eq. (10)),"
        " its covariance (F' S^-1 F)^-1, eq. (9). Criterion c1 is the condition number of S^-1/2 F with columns of"
        " length one, c2 the determinant of the covariance. After 10,000 iterations of sequential quadratic"
        " programming c1 has condition number 4.15 and determinant 1.76e-43, c2 5.94 and 2.36e-49. 200 identifications"
        f" with simulated noise: the means of {printed.MEANS_INSIDE} of 21 parameters lie within sigma / sqrt(200) of"
        f" the truth, the standard deviations of {printed.RATIOS_INSIDE} of 21 inside their 90 % interval. With 500"
        " samples instead of 1500 the estimates are said to be biased.",
        (
            "One period of 1500 samples at 150 Hz, torque noise of variance 25, 26, 10 (Nm)^2 (an average of 16"
            " periods), joint angles exact, as in the paper. Limits, those of the paper: |q| < 1.6, 1.2, 1.2 rad,"
            " 1.45 rad/s, 3 rad/s^2,"
            " flange above 0.8 m and never nearer than 0.7 m to axis 1 below 1.8 m. All are certified over continuous"
            f" time; the flange stays {_clearance(found, 'condition'):.4f} m (c1) and"
            f" {_clearance(found, 'd-optimal'):.4f} m (c2) away from what is forbidden.",
            f"The c2-optimal trajectory reaches a determinant of {power(best.evaluation.log10_det_covariance)}: sigma"
            f" is {float(np.exp(np.mean(np.log(ratio)))):.2f} times the printed one in the geometric mean"
            f" ({ratio.min():.2f} to {ratio.max():.2f}). No trajectory within the limits gets below"
            f" {power(bound.log10_det_covariance)}: the D-efficiency, (least conceivable determinant /"
            f" determinant)^(1/21), is at least {bound.efficiency(best.evaluation.log10_det_covariance):.0%} (the"
            f" paper's {bound.efficiency(printed.LOG10_DET['d-optimal']):.0%}). Of the 21"
            f" sigmas {int(np.sum(ratio > 1))} are larger than printed: the determinant weighs all parameters"
            f" together. Of the c1-optimal trajectory {int(np.sum(of_c1 > 1))} are, by up to {of_c1.max():.2f}"
            f" (p{int(np.argmax(of_c1)) + 1}): the condition number weighs the worst direction alone.",
            "For c1 the determinant must be no larger than that of the best of 400 random trajectories: the condition"
            " number alone would prefer slow motions, since it doesn't change when all columns shrink.",
            "By chance 14.3 of 21 means lie within one sigma / sqrt(200), and 18.9 of 21 ratios inside their 90 %"
            " interval. The exact tests of the last two columns use all parameters with their covariance: n D' C^-1 D"
            " of the mean errors D is chi-square with 21 degrees of freedom, the mean of e' C^-1 e / 21 over the runs"
            " is 1.",
            "With every third sample, 500, the estimates are"
            + (" not biased" if unbiased else " outside the interval of an unbiased estimator")
            + f" either; sigma grows by {wider:.2f}, the root of 3. Least squares with exact regressors is unbiased for"
            " any number of samples.",
        ),
        (
            Plot(
                trajectories_figure({"c1 (fig. 2)": other.excitation, "c2 (fig. 3)": best.excitation}, found.robot),
                f"c1: {trajectory_text(other.excitation, found.robot)}"
                f" c2: {trajectory_text(best.excitation, found.robot)}",
                "One period. Dashed: limits of the joint of that colour, grey where joints share one.",
            ),
            Table(
                ("trajectory", *(word for name in quantities for word in (f"{name}, paper", "here"))),
                criteria,
                numeric=(1, 2, 3, 4, 5, 6),
            ),
            Plot(
                figures.sigmas_figure(found),
                "Standard deviations of 21 parameters; of the c2-optimal trajectory"
                f" {int(np.sum(ratio < 1))} are smaller than the printed ones, the ratio runs from {ratio.min():.2f} to"
                f" {ratio.max():.2f}.",
                "Table II: predicted standard deviations.",
            ),
            _table_ii(found),
            Table(
                (
                    "trajectory",
                    "samples",
                    f"means inside (paper: {printed.MEANS_INSIDE})",
                    f"ratios inside (paper: {printed.RATIOS_INSIDE})",
                    "interval of the ratio",
                    "bias (99.8 % interval)",
                    "spread (3 sigma)",
                ),
                counts,
                numeric=(1, 2, 3),
            ),
        ),
        "Better trajectories by a multi-start search of a smooth problem with exact derivatives; the estimates behave"
        " as the paper finds. Three slips: the text prints -log det of the covariance as c2, which would be maximised;"
        " the interval of the ratio of standard deviations is .919 to 1.084 by the"
        f" paper's formula ({printed.RATIO_INTERVAL[0]:.3f} to {printed.RATIO_INTERVAL[1]:.3f} are printed), and the"
        " bias with 500 samples can't be, unless the regressor is noisy.",
        again(
            study,
            2,
            "robot_ident design --criterion condition --bound -o c1.yaml",
            "robot_ident design --bound -o c2.yaml",
            "robot_ident montecarlo c2.yaml --runs 200",
        ),
    )


def _clearance(found: Excitations, criterion: str) -> float:
    """Return how far [m] the flange stays from the forbidden regions, certified."""
    margins = certify(found.optimal[criterion].excitation, found.robot)
    return min(item.margin for item in margins.items if item.quantity == "workspace")


def _table_ii(found: Excitations) -> Table:
    one, two = (found.optimal[criterion].runs for criterion in CRITERIA)
    columns = (
        ("sigma c1, paper", printed.SIGMA["condition"]),
        ("here", one.sigma),
        ("sigma c2, paper", printed.SIGMA["d-optimal"]),
        ("here", two.sigma),
        ("Cramér-Rao, c2", found.sigma_cr),
        ("200 runs, c2: mean", two.mean),
        ("sigma", two.sample_sigma),
    )
    rows = []
    for k in range(len(found.names)):
        digits = max(4, 1 - int(np.floor(np.log10(two.sigma[k]))))
        rows.append((f"p{k + 1}", f"{two.true[k]:.2f}", *(f"{values[k]:.{digits}f}" for _, values in columns)))
    return Table(("parameter", "true", *(name for name, _ in columns)), rows, numeric=range(1, 9))


def iteration_section(study: Study) -> Section:
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
    last = found.rounds[-1].sigma
    apart = float(np.exp(np.mean(np.log(last / study.excitations.optimal["d-optimal"].runs.sigma))))
    gain = float(np.max(np.abs(study.excitations.sigma_cr / study.excitations.optimal["d-optimal"].runs.sigma - 1.0)))
    return paper_section(
        "3. Design by the Cramér-Rao bound, iterated (section III-B)",
        "Measured positions and torques are q(k) + n_q(k) and tau(k) + n_tau(k), eq. (2). Maximum likelihood minimises"
        " K = 1/2 sum_k sum_i [(q_m,i - q_i(delta, k))^2 / s_q,i^2 + (tau_m,i - tau_i(vartheta, k))^2 / s_tau,i^2],"
        " eqs. (3) and (4), over vartheta = [theta; delta], eq. (5): the parameters theta and the Fourier coefficients"
        " delta of the motion. It is minimised by Gauss-Newton or Levenberg-Marquardt, from delta by least squares"
        " and theta by eq. (10) (here by Levenberg-Marquardt, from eq. (7)). Its covariance tends to the Cramér-Rao"
        " bound, eq. (6), which depends on the parameters:"
        " design by c1, measure, estimate, minimise the bound at that estimate, measure again, until nothing changes."
        " No figures are given.",
        (
            f"The iteration {found.in_words}. Its first measurement plays the c1-optimal trajectory of section 2;"
            f" bounds"
            " are computed with the noise that was measured, whence small differences to section 2.",
            f"The noise of the averaged positions (the paper's variance {numbers(printed.POSITION_VARIANCE, 'g')}"
            f" rad^2) changes"
            f" the standard deviations of Table II by at most {gain:.0e} of themselves (there: column Cramér-Rao). The"
            " bound is therefore that of c2, and the iteration is a second search for a c2-optimal trajectory: its"
            f" mean sigma differs by {100 * (apart - 1):+.1f} % from that of section 2, where the search was longer.",
            "The estimates: on the robot that the model describes (section 4) maximum likelihood moves no parameter by"
            f" more than {study.measuring.likelihood_moves:.1g} of its sigma from weighted least squares. The paper"
            " finds no difference on the real robot, either (section 5 on a robot with more friction than its model).",
        ),
        (
            Plot(
                figures.rounds_figure(found, bound.log10_det_covariance),
                "log10 of the determinant of the bound:"
                f" {numbers((one.log10_det_bound for one in found.rounds), '.2f')}.",
            ),
            Table(
                ("measurement", "designed by", "log10 det of the bound", "condition number", "sigma, geometric mean"),
                rows,
                numeric=(0, 2, 3, 4),
            ),
        ),
        "Eq. (6) as printed is a product of gradients, zero at the optimum; used here is the information F = sum_k J'"
        " W J, J the derivative of (q, tau) by vartheta, W the inverse variances. Its blocks F_tt of theta, F_dd of"
        " delta, F_td of both give the bound of theta, (F_tt - F_td F_dd^-1 F_dt)^-1. The stop rule (2 % of the"
        " geometric mean of the sigmas) is ours.",
        again(study, 3, "robot_ident design --criterion crlb --iterate -o last.yaml"),
    )
