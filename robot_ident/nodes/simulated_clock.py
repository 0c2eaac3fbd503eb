"""Publishes simulated time that no node falls behind, however loaded the machine is."""

from __future__ import annotations

import threading
import time
from functools import partial
from typing import ClassVar

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from robot_ident.nodes.messages import stamp_of, time_message
from robot_ident.nodes.node import BaseNode, reliable, run
from robot_ident.nodes.outputs import TrajectoryOutput
from robot_ident.nodes.parameters import Parameter
from robot_ident.nodes.subscriptions import poll

_POLL = 0.0005  # s between looks at those who are waited for


class SimulatedClock(BaseNode):
    """Advances `/clock` step by step, at most `speed` times real time; joint_states and joint_command must keep up.

    With it, and `use_sim_time` at the others, a loaded machine slows a simulated experiment and doesn't disturb it.
    """

    node_name: ClassVar[str] = "simulated_clock"
    description: ClassVar[str] = "publishes /clock no faster than simulated robot and publisher can follow"
    table: ClassVar[tuple[Parameter, ...]] = (
        Parameter("speed", 1.0, "largest speed of simulated time, times real time", 0.01, 100.0),
        Parameter("rate", 300.0, "rate of /clock, in simulated time", 10.0, 5000.0, unit="Hz"),
        Parameter(
            "ahead", 0.02, "how far time may run ahead of the newest joint state and command", 0.001, 1.0, unit="s"
        ),
        Parameter(
            "patience",
            2.0,
            "real time after which joint states or commands that have fallen silent are no longer waited for",
            0.1,
            3600.0,
            unit="s",
        ),
        Parameter(
            "controller",
            "",
            "name of a joint_trajectory_controller that is commanded: NAME/joint_trajectory must keep up as well"
            " ('' for none)",
        ),
    )

    def __init__(self) -> None:
        """Start time at the machine's own."""
        super().__init__()
        self._newest: dict[str, tuple[int, float]] = {}
        self._patience: float = self.value("patience")
        self._clock_topic = self.create_publisher(Clock, "/clock", reliable(10))
        self._polled = [
            poll(self, JointState, topic, partial(self._heard, topic, 0), reliable(1000))
            for topic in ("joint_states", "joint_command")
        ]
        if self.value("controller"):
            topic = f"{self.value('controller').rstrip('/')}/joint_trajectory"
            due_ns = round(1e9 * (TrajectoryOutput.lead + 1.5 * TrajectoryOutput.every))  # from a window's first point
            self._polled.append(poll(self, JointTrajectory, topic, partial(self._heard, topic, due_ns), reliable(10)))
        self._thread = threading.Thread(target=self._run, name="clock", daemon=True)
        self._thread.start()

    def _heard(self, topic: str, later_ns: int, message: JointState | JointTrajectory) -> None:
        """Note how far the sender of a message has come: `later_ns` after its stamp."""
        self._newest[topic] = (stamp_of(message) + later_ns, time.monotonic())

    def _run(self) -> None:
        """Publish one step after another; a step waits for real time and for the slowest stream."""
        speed, step_ns = self.value("speed"), round(1e9 / self.value("rate"))
        ahead_ns = round(1e9 * self.value("ahead"))
        now_ns = time.time_ns()
        due = time.monotonic()
        while not self.ended:
            due = max(due + step_ns * 1e-9 / speed, time.monotonic())
            while not self.ended and (time.monotonic() < due or self._behind(now_ns - ahead_ns)):
                time.sleep(_POLL)
                for take in self._polled:
                    take()
            now_ns += step_ns
            self._clock_topic.publish(Clock(clock=time_message(now_ns)))

    def _behind(self, bound_ns: int) -> bool:
        """Return whether a stream that is alive has not come as far as `bound_ns`."""
        oldest = time.monotonic() - self._patience
        return any(stamp < bound_ns and heard > oldest for stamp, heard in list(self._newest.values()))

    def close(self) -> None:
        """Join the thread."""
        self.end()
        self._thread.join()


main = partial(run, SimulatedClock)

if __name__ == "__main__":
    raise SystemExit(main())
