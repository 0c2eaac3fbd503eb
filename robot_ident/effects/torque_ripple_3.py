"""The third line of the torque that ripples with the motor's turns."""

from __future__ import annotations

from robot_ident.effects.torque_ripple import TorqueRipple, order_of_a_line


class TorqueRipple3(TorqueRipple):
    """The third line of a ripple, of another order than the stronger ones."""

    name = "torque_ripple_3"
    meaning = "third line of the torque ripple of motor and gear"
    inner = (order_of_a_line(3.5),)
    after = "torque_ripple_2"
