"""The second line of the torque that ripples with the motor's turns."""

from __future__ import annotations

from robot_ident.effects.torque_ripple import TorqueRipple, order_of_a_line


class TorqueRipple2(TorqueRipple):
    """The second line of a ripple, of another order than the stronger ones."""

    name = "torque_ripple_2"
    meaning = "second line of the torque ripple of motor and gear"
    inner = (order_of_a_line(2.5),)
    after = "torque_ripple"
