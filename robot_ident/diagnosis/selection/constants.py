"""What the selection takes for granted: each constant with its meaning, its unit and where it comes from."""

from __future__ import annotations

from robot_ident.effects.catalogue import RIPPLES

STANDARD_ERRORS = 2.5
"""By which the parts of an effect must predict held-out blocks better than the whole: .6 % one-sided by chance, since a
dozen splits are tried."""

FORMULA_ERROR = 0.15
"""Relative rms error of an effect's formula: what it leaves of a real cause is no second cause."""

FIRST_ORDER_ERROR = {"joint_elasticity": 0.4, "external_force": 0.4, "backlash": 0.5} | {x.name: 0.4 for x in RIPPLES}
"""The same of formulas that hold to first order in a small displacement, that of a rope in its length. Under a ripple
faster than its servo a joint gives way, less than noise shows."""

SIZE_ERROR = 0.11
"""Relative standard error, errors of a block taken together, to which the size of an effect must be known; of formulas
that are less exact as much more."""

SIZE_ERROR_OF_FRICTION = 0.15
"""The same of friction of the joint's own drive."""

COMPLETE_SIZE_ERROR = 0.2
"""The same of all effects where the set leaves no joint more than formulas, the least torque and noise do: what stands
in the place of an unknown cause explains it in part."""

VAGUE = 0.5
"""The same from which on an effect is not listed either: zero lies within two standard errors."""

SHARE = 0.5
"""Of what the other effects leave of a joint that an effect must explain on motion that was not fitted."""

PARTIAL_SHARE = 0.2
"""The same of friction of the joint's own drive, and of all effects where noise is not known, so that it counts as
left: names of less were not found again in other recordings of real arms."""

REMAINDER = 2.0
"""What may be left of a joint, in units of what formulas, the least torque and noise leave, for an effect to be named
that is not friction of its own drive."""

CREEP = 0.01
"""Of a joint's largest speed, below which it creeps or sticks: dry friction rises there with speed or displacement, and
no formula tells it."""

FLEXIBLE_SHARE = 0.2
"""Of a joint's excess by which a flexible model may predict it better before the cause counts as unknown."""

FLEXIBLE_ERRORS = 3.0
"""Standard errors by which it must do so."""

CHANCE = 0.05
"""Of noise of the spectrum of what an effect would explain, that some effect explains as much of it: the usual
significance, over all effects and joints together."""

NAMED = 0.8
"""Probability from which on an effect is named; below, it is listed with its alternatives."""

ALTERNATIVE = 0.05
"""Share of the resamples from which on another set counts as an alternative."""

RESAMPLES = 200
"""Of the blocks, for the probabilities: .8 +- .03."""

PAIRS = 25
"""Pairs on one joint that get a held-out look, the best by the score test."""

REFINED = 4
"""Hypotheses whose nonlinear parameters are refined in one step, the best by held-out gain."""

LARGEST_SET = 12
"""Effects that are selected at most."""
