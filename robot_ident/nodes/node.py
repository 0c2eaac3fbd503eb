"""What every node shares: its parameters, its life from start to a clean end, and quality of service."""

from __future__ import annotations

import gc
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import IntEnum
from itertools import islice
from types import FrameType, TracebackType
from typing import Any, ClassVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.utilities import remove_ros_args

from robot_ident.bags import Qos
from robot_ident.errors import InputError, RobotIdentError
from robot_ident.nodes.parameters import Parameter, Value, declare, usage
from robot_ident.parallel import PARENT, end_with
from robot_ident.playback.periodic_timer import follow_at, follow_no_more

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
_SWITCH = 0.001  # s for which one thread may keep another from running; Python's own 5 ms are most of a tick at 150 Hz
_LOOK = 0.002  # s between looks at what messages wait
_SERVE = 0.05  # s between looks at services, timers and what the middleware tells, which cost the most
AT_ONCE = 200  # messages of a topic that are taken in one go, before the other topics and services have their turn


def reliable(depth: int, *, kept: bool = False) -> QoSProfile:
    """Return the profile of the project's topics: nothing is lost while the reader keeps up within `depth` messages.

    kept: who comes later hears the latest.
    """
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE,
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
    )


def latched() -> QoSProfile:
    """Return the profile of what is told now and then: who comes later hears the latest."""
    return reliable(1, kept=True)


def offered(offers: Sequence[TopicEndpointInfo], depth: int) -> QoSProfile:
    """Return the profile that hears all who publish on a topic: as reliable, and as early, as each of them can."""
    every = [offer.qos_profile for offer in offers]
    profile = reliable(depth, kept=all(one.durability == DurabilityPolicy.TRANSIENT_LOCAL for one in every))
    if any(one.reliability == ReliabilityPolicy.BEST_EFFORT for one in every):
        profile.reliability = ReliabilityPolicy.BEST_EFFORT
    return profile


def qos_of(profile: QoSProfile) -> Qos:
    """Return a profile in the words of bags."""

    def word(policy: IntEnum) -> str:
        return policy.name.lower()

    return Qos(
        history=word(profile.history),
        depth=profile.depth,
        reliability=word(profile.reliability),
        durability=word(profile.durability),
        deadline_ns=profile.deadline.nanoseconds,
        lifespan_ns=profile.lifespan.nanoseconds,
        liveliness=word(profile.liveliness),
        liveliness_lease_duration_ns=profile.liveliness_lease_duration.nanoseconds,
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )


def overridable() -> QoSOverridingOptions:
    """Return the options by which users change a profile (`qos_overrides./joint_states.subscription.depth`)."""
    return QoSOverridingOptions.with_default_policies()


THREAD_PRIORITY = Parameter(
    "thread_priority",
    50,
    "real-time priority (SCHED_FIFO) of the thread that keeps time, where the machine allows it; 0: none",
    0,
    99,
)


class Executor(SingleThreadedExecutor):
    """Runs services, timers and what the middleware tells of publishers; `BaseNode.take_messages` takes messages.

    An executor of rclpy asks all that a node has whenever it wakes, which costs several times what a message does.
    """

    def run_ready(self) -> None:
        """Run all that is ready once, and wait for nothing: without time, a pass over everything ends by a timeout."""
        while True:
            try:
                work, _, _ = self.wait_for_ready_callbacks(timeout_sec=0.0)
            except TimeoutException:
                return
            work()
            work.result()


def left_to_takers(message: Any) -> None:
    """Do nothing: the callback of subscriptions that one of a node's `takers` looks after."""


def waiting(subscription: Subscription) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield the messages that wait for a subscription, with what the middleware tells of each, until none does."""
    while True:
        try:
            with subscription.handle:
                found = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        except InvalidHandle:
            return
        if found is None:
            return
        yield found


class BaseNode(Node):
    """A node with its parameters declared; a subclass names them and itself.

    takers: what hands the messages of a topic that wait to whom they concern, and tells whether there were any.
    """

    node_name: ClassVar[str]
    description: ClassVar[str]
    table: ClassVar[tuple[Parameter, ...]]
    status_topic: ClassVar[str] = ""
    """Where the node tells its status besides `/diagnostics`."""

    def __init__(self) -> None:
        """Declare the parameters; InputError when one doesn't fit."""
        self.takers: list[Callable[[], bool]] = []
        Node.__init__(self, self.node_name)
        declare(self, self.table)
        topics = ("/diagnostics", self.status_topic)
        self._told_on = [self.create_publisher(DiagnosticArray, topic, 10) for topic in topics if topic]
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._end = threading.Event()
        self._failure: BaseException | None = None

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """None that an executor would look after."""
        return iter(())

    def take_messages(self) -> bool:
        """Hand on the messages that wait, those of /clock first; return whether there were any."""
        took = False
        for own in [one for one in super().subscriptions if one.callback is not left_to_takers]:
            for message, _ in islice(waiting(own), AT_ONCE):
                took = True
                own.callback(message)
        for take in tuple(self.takers):
            took |= take()
        return took

    def value(self, name: str) -> Any:
        """Return a parameter's present value."""
        value: Value = self.get_parameter(name).value
        return list(value) if isinstance(value, Sequence) and not isinstance(value, str) else value

    def texts(self, name: str) -> list[str]:
        """Return a list of texts without the empty ones."""
        return [text for text in self.value(name) if text]

    def per_joint(self, name: str, joints: Sequence[str]) -> list[float]:
        """Return one number a joint of a parameter that gives one for all or one for each."""
        values: list[float] = self.value(name)
        if len(values) not in (1, len(joints)):
            raise InputError(
                f"parameter {name} has {len(values)} values; give one, or one for each of {', '.join(joints)}"
            )
        return values * len(joints) if len(values) == 1 else values

    def every(self, seconds: float, callback: Callable[[], None]) -> Timer:
        """Call back every so many seconds of real time, whatever the node's clock says."""
        return self.create_timer(seconds, callback, clock=self._steady)

    def tick_priority(self) -> int:
        """Return the priority of the thread that keeps real time, and let this one follow it; 0 in simulated time, or
        where none is allowed.
        """
        priority: int = self.value(THREAD_PRIORITY.name)
        if priority == 0 or self.get_parameter("use_sim_time").value:
            return 0
        if follow_at(priority):
            return priority
        self.get_logger().warning(
            "no real-time priority is allowed here (CAP_SYS_NICE, or rtprio in /etc/security/limits.d): other programs"
            " may delay what is sent"
        )
        return 0

    def now_ns(self) -> int:
        """Return the time of the node's clock [ns]: the machine's, or that of `/clock` under `use_sim_time`."""
        return int(self.get_clock().now().nanoseconds)

    @property
    def ended(self) -> bool:
        """Whether the node is to end."""
        return self._end.is_set()

    def end(self) -> None:
        """End the node; from any thread."""
        self._end.set()

    def wait_end(self, seconds: float) -> bool:
        """Wait so long, or until the node is to end; return whether it is."""
        return self._end.wait(seconds)

    def fail(self, error: BaseException) -> None:
        """End the node with an error; from any thread."""
        if self._failure is None:
            self._failure = error
        self.end()

    def raise_failure(self) -> None:
        """Raise the error that ended the node, if one did."""
        if self._failure is not None:
            raise self._failure

    def request_end(self, reason: str) -> None:
        """Answer a signal; a subclass that moves something brings it to rest first."""
        self.end()

    def close(self) -> None:
        """Release what the node holds: threads joined, files closed."""

    def tell(self, level: bytes, message: str, values: Mapping[str, object]) -> None:
        """Publish the node's status on `/diagnostics` and where it is told besides."""
        status = DiagnosticStatus(
            level=level,
            name=self.get_fully_qualified_name().lstrip("/"),
            message=message,
            hardware_id="",
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        for publisher in self._told_on:
            publisher.publish(array)


class Interrupted(BaseException):
    """A signal has come while a node starts.

    Not a KeyboardInterrupt: where one breaks into code that is made as it runs (`exec`, in each dataclass), Python
    remembers it for good and lets `python -m` end by the signal, though it was caught.
    """


class Signals:
    """SIGINT and SIGTERM: they interrupt the start of a node, ask it to end while it runs, and do nothing at its end.

    The handlers are Python's own rather than rclpy's, which shut the context down at once: nothing could be published
    any more, not even a smooth stop. They also work where SIGINT was inherited as ignored. While a node runs they only
    note the signal: it may come in the middle of a callback, under a lock that its answer would wait for. A start that
    swallows the interruption (Python does, where it comes in a destructor) finds the signal noted when it is through;
    one that makes another error of it (SWIG's wrappers do) is known by `interrupted`.
    """

    def __init__(self) -> None:
        """Nothing is caught before the block is entered."""
        self.noting = False
        self.closing = False
        self._noted = ""

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.closing:
            return
        first, self._noted = not self._noted, signal.Signals(number).name
        if first and not self.noting:
            raise Interrupted

    @property
    def interrupted(self) -> bool:
        """Whether a signal has come before the start was through."""
        return bool(self._noted) and not self.noting

    def take(self) -> str:
        """Return the name of a signal that has come since this was asked last, or an empty text."""
        noted, self._noted = self._noted, ""
        return noted

    def __enter__(self) -> Signals:
        """Install the handlers."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._handle)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ignore what still comes while the process ends: Python takes its own handlers away before it is through."""
        self.closing = True
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)


class Abandoned(threading.Thread):
    """A daemon whose work is of no use once the node ends, and that can't be interrupted: nobody waits for it."""


def run(make: type[BaseNode], argv: Sequence[str] | None = None) -> int:
    """Run a node until it ends; return the exit code: 0, or that of an error of ours, told in one line.

    Where an `Abandoned` thread still works the process ends here: Python would take its libraries apart meanwhile.
    """
    code = _run(make, list(sys.argv if argv is None else argv))
    if any(isinstance(thread, Abandoned) for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


def _run(make: type[BaseNode], argv: list[str]) -> int:
    signals = Signals()
    try:
        with signals:
            if not _asks_for_usage(make, argv):
                _live(make, argv, signals)
    except BaseException as error:
        if signals.interrupted:
            return 0  # before anything had begun; whatever the error, it may have come of the interruption
        if not isinstance(error, RobotIdentError):
            raise
        get_logger(make.node_name).fatal(str(error))
        return error.exit_code
    return 0


def _asks_for_usage(make: type[BaseNode], argv: list[str]) -> bool:
    """Answer -h and --help; InputError for any other argument that isn't one of ROS."""
    with _ros_refusals():
        rest = remove_ros_args(argv)[1:]
    if "-h" in rest or "--help" in rest:
        get_logger(make.node_name).info(usage(make.node_name, make.description, make.table))
        return True
    if rest:
        raise InputError(f"unknown argument {rest[0]!r}; parameters are given as --ros-args -p NAME:=VALUE")
    return False


def _live(make: type[BaseNode], argv: list[str], signals: Signals) -> None:
    """From init to shutdown; whatever the node holds is released on every way out."""
    if (parent := os.environ.pop(PARENT, "")).isdigit():
        end_with(int(parent), by_kernel=True, number=signal.SIGINT)
    if not any(os.environ.get(name) for name in ("ROS_LOG_DIR", "ROS_HOME", "HOME")):
        # ROS refuses to start where it finds no place for its log files
        os.environ["ROS_LOG_DIR"] = os.path.join(tempfile.gettempdir(), "ros_log")
    with _ros_refusals():
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
    node: BaseNode | None = None
    executor = Executor()
    try:
        node = make()
        signals.noting = True
        _be_prompt()
        executor.add_node(node)
        serve = time.monotonic()
        while rclpy.ok() and not node.ended:
            took = node.take_messages()
            if time.monotonic() >= serve:
                executor.run_ready()
                serve = time.monotonic() + _SERVE
            elif not took:
                time.sleep(_LOOK)
            if reason := signals.take():
                node.request_end(reason)
        node.raise_failure()
    except ExternalShutdownException:
        return  # somebody else ended the context: an end like any other
    finally:
        signals.closing = True
        try:
            if node is not None:
                node.close()
        finally:  # also where the last words can't be written: the disk is full
            follow_no_more()
            if node is not None:
                executor.remove_node(node)
                node.destroy_node()
            executor.shutdown(timeout_sec=0.0)
            rclpy.try_shutdown()


@contextmanager
def _ros_refusals() -> Iterator[None]:
    """Turn what ROS says of arguments that it can't read into one line."""
    try:
        yield
    except Exception as error:
        if type(error).__name__ not in ("RCLError", "RCLInvalidROSArgsError", "UnknownROSArgsError"):
            raise  # rclpy keeps the class of the first two in a private module
        raise InputError(str(error).split(", at /")[0].removeprefix("failed to initialize rcl: ")) from error


def _be_prompt() -> None:
    """Keep Python's own housekeeping from standing in the way of a tick.

    What was made at the start lives as long as the node: without `freeze` a collection looks through all of it again
    and again, for 0.3 s each time, and no thread runs meanwhile.
    """
    sys.setswitchinterval(_SWITCH)
    gc.collect()
    gc.freeze()
