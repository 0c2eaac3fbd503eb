"""The figures that Swevers et al. (1997) print, IEEE Transactions on Robotics and Automation 13(5), pp. 730-740.

All determinants, condition numbers and standard deviations are those of one averaged period: 1500 samples a joint,
torque noise of variance 25, 26, 10 (Nm)^2. SI units, the spring's k l0 in kN.
"""

from __future__ import annotations

import math

PARAMETERS: tuple[str, ...] = (
    *(f"p{k}" for k in range(1, 16)),
    *(f"{effect}@joint_{k}" for effect in ("viscous", "coulomb") for k in (1, 2, 3)),
)
"""The 21 parameters of section IV, p1 to p21, by our names."""

TABLE_I: tuple[float, ...] = (
    *(45.38, -0.31, -2.22, -28.69, 0.3, -0.2, 3.36, 41.74, 0.07, 2.6, 8.21, 0.07, -0.21, 0.69, 7.63),
    *(17.76, 33.48, 23.11, 35.12, 6.35, 14.51),
)
"""Table I, in the order of PARAMETERS: kg m^2, kg m, Nm s/rad, Nm."""

MEANING: tuple[str, ...] = (
    "Izz1 + Iyy2 + l^2 m3 + Iyy3, and rotor 1",
    "m2 lx2 + l m3",
    "m2 ly2",
    "Ixx2 - Iyy2 - l^2 m3",
    "Ixy2",
    "Ixz2 - l m3 lz3",
    "Iyz2",
    "Izz2 + l^2 m3, and rotor 2",
    "m3 lx3",
    "m3 ly3",
    "Ixx3 - Iyy3",
    "Ixy3",
    "Ixz3",
    "Iyz3",
    "Izz3",
    *(f"viscous friction of joint {k}" for k in (1, 2, 3)),
    *(f"Coulomb friction of joint {k}" for k in (1, 2, 3)),
)

_SIGMA = {
    "condition": """.2024 .0283 .0251 .3678 .1828 .1592 .1459 .1953 .0115 .0178 .2881 .1563 .0791 .0757 .0679
        .4178 .2111 .3497 .2345 .1731 .1429""",
    "d-optimal": """.1503 .0303 .0199 .1674 .0878 .0866 .0920 .1449 .0140 .0152 .1184 .0616 .0343 .0436 .0463
        .4366 .2872 .3008 .2248 .2185 .1970""",
}
SIGMA: dict[str, tuple[float, ...]] = {
    criterion: tuple(float(word) for word in words.split()) for criterion, words in _SIGMA.items()
}
"""Table II: predicted standard deviations of the trajectory of either criterion, in the order of PARAMETERS."""

DETERMINANT = {"d-optimal": 2.36e-49, "condition": 1.76e-43}
LOG10_DET = {criterion: math.log10(value) for criterion, value in DETERMINANT.items()}
CONDITION = {"d-optimal": 5.94, "condition": 4.15}
"""Section IV: both criteria of the c2- (`d-optimal`) and of the c1-optimal (`condition`) trajectory."""

RUNS, MEANS_INSIDE, RATIOS_INSIDE = 200, 16, 19
"""Section IV: runs; parameters of 21 whose mean, and whose ratio of standard deviations, lay inside its interval."""

RATIO_INTERVAL = (0.923, 1.089)
"""As printed; the paper's own formula gives .919 to 1.084."""

SPRING_DETERMINANT = {"d-optimal": 1.85e-56, "condition": 5.26e-46}
SPRING_LOG10_DET = {criterion: math.log10(value) for criterion, value in SPRING_DETERMINANT.items()}
SPRING_CONDITION = {"d-optimal": 111.7, "condition": 47.3}
"""Section V: both criteria with torque offsets and the spring of axis 2 among the parameters."""

POSITION_VARIANCE = (1.1223e-10, 8.2822e-11, 2.9061e-10)
"""Section V: noise variance of the positions after averaging 16 periods, rad^2, by joint."""

FILTER_ORDER, FILTER_CUTOFF = 8, 40.0
"""Section V-A: Butterworth filters on the motor currents, cutoff in Hz."""

NOISE = (25.1, 26.5, 9.5)
"""Section V-B: noise variance of 16 averaged periods, (Nm)^2, by joint."""

RESIDUAL = (81.1, 88.8, 23.1)
"""Section V-B: mean squared residual of model 2 on the trajectory that it was fitted to, (Nm)^2."""

VALIDATION = (45.0, 53.6, 12.0)
"""Section V-C: mean squared residual of model 2 on 20 random points, everything low-passed at 10 Hz, (Nm)^2."""

MODEL_1_WORSE = 0.2
"""Section V-C: share by which model 1 is worse on axis 1."""
