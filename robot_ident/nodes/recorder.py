"""Records topics to a rosbag2 folder, byte for byte as they come from DDS, for every reader at any moment."""

from __future__ import annotations

import importlib
import shutil
import threading
import time
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import ClassVar

from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from robot_ident.bags import BagWriter, Topic, qos_text
from robot_ident.errors import InputError, RobotIdentError
from robot_ident.nodes.effort_topics import sources_of, topics_of
from robot_ident.nodes.messages import definition_of
from robot_ident.nodes.node import ERROR, OK, WARN, BaseNode, offered, qos_of, reliable, run
from robot_ident.nodes.parameters import Parameter, live
from robot_ident.nodes.subscriptions import Hearing
from robot_ident.playback.stamps import SequenceWatch, StampWatch, header_stamp
from robot_ident.robot import load_robot

_TAKE = 0.01  # s between looks at what has come
_FLUSH = 0.05  # s after which what was taken is on file, for everybody to read, whatever becomes of the recorder
_ORDERED = 100_000_000  # ns by which a message may come later than one that was received after it
_DRAIN = 2.0  # s that the end of a recording waits for messages that have come and aren't written yet
_IDLE = 20  # looks of 5 ms without a message after which none waits any more
_SYNC = 0.5  # s between syncs, which may themselves take as long on a slow disk: nothing older than a second is lost
_LOOK = 0.5  # s between looks for topics whose type isn't known yet
_STATES = "sensor_msgs/msg/JointState"


@dataclass(frozen=True)
class _Message:
    """A message that was taken, with what the middleware told of it; times in ns."""

    stream: str
    data: bytes
    received: int
    sent: int
    number: int


@dataclass
class Stream:
    """One recorded topic: what was received of it."""

    topic: Topic
    has_header: bool
    listed: bool = False  # whether the bag knows it
    stamps: StampWatch = field(default_factory=StampWatch)
    numbers: SequenceWatch = field(default_factory=SequenceWatch)

    def summary(self) -> str:
        """Say in words what was received and lost."""
        s = self.stamps
        rate = f" at {s.rate:.1f} Hz" if s.rate else ""
        return (
            f"{s.received} messages{rate}, {self.numbers.lost} lost on the way, "
            f"{s.gaps} gaps ({s.missing} samples missing), {s.duplicates} repeated stamps, {s.late} late"
        )


def message_class(kind: str) -> type:
    """Return the class of a message type such as `tf2_msgs/msg/TFMessage`; InputError when it isn't installed."""
    module, _, name = kind.rpartition("/")
    try:
        found: type = getattr(importlib.import_module(module.replace("/", ".")), name)
    except (ImportError, ValueError, AttributeError) as error:
        raise InputError(f"the message type {kind!r} is not installed ({error})") from error
    return found


class Recorder(BaseNode):
    """Subscribes raw, writes the messages of all topics in the order in which they came, counts what is missing."""

    node_name: ClassVar[str] = "recorder"
    description: ClassVar[str] = "records joint states, commands and further topics to a rosbag2 folder (MCAP)"
    status_topic: ClassVar[str] = "~/status"
    table: ClassVar[tuple[Parameter, ...]] = (
        live(
            "output",
            "",
            "folder of the bag, made by the recorder; it must not exist (empty: a name from date and time)",
        ),
        Parameter(
            "topics", [""], "further topics to record: NAME, or NAME:TYPE as in tf:tf2_msgs/msg/TFMessage ('' for none)"
        ),
        Parameter("robot", "", "robot YAML whose topics of efforts (effort.topic) are recorded as well ('' for none)"),
        Parameter("autostart", True, "start recording at once; otherwise by ~/start"),
        live("compress", False, "compress the bag by zstd"),
        live(
            "split_size", 0, "start a new file of the bag after so many megabytes (0: never)", 0, 1_000_000, unit="MB"
        ),
        live("split_duration", 0.0, "start a new file of the bag after so many seconds (0: never)", 0.0, 1e7, unit="s"),
        Parameter("depth", 5000, "messages a topic that may wait to be written", 1, 1_000_000),
        Parameter("status_rate", 1.0, "how often ~/status is published", 0.1, 50.0, unit="Hz"),
    )

    def __init__(self) -> None:
        """Subscribe, and start recording where `autostart` says so."""
        super().__init__()
        self._lock = threading.Lock()
        self._bag: BagWriter | None = None
        self._streams: dict[str, Stream] = {}
        self._begun = 0.0
        self._file_begun = 0.0
        self._split_at = (0, 0.0)  # bytes, s
        self._newest_ns = 0
        self._hearings: dict[str, Hearing] = {}
        self._held: list[_Message] = []
        self._written_ns = 0
        self._flushed = self._taken = 0.0
        self._sought = [entry.partition(":")[0] for entry in self.texts("topics")]
        self._kinds = {"joint_states": _STATES, "joint_command": _STATES}
        self._kinds |= {
            name: kind for name, _, kind in (entry.partition(":") for entry in self.texts("topics")) if kind
        }
        if self.value("robot"):  # the topics as well on which its YAML says that efforts stand
            efforts = topics_of(sources_of(load_robot(self.value("robot")), self))
            self._sought += [name for name in efforts if name not in self._sought]
        if self.value("autostart"):
            self._start()
        for name in ("joint_states", "joint_command"):
            self._subscribe(name, JointState, _STATES, reliable(self.value("depth")))
        self.create_service(Trigger, "~/start", self._on_start)
        self.create_service(Trigger, "~/stop", self._on_stop)
        self.every(1.0 / self.value("status_rate"), self._tell)
        self.every(_LOOK, self._look)
        self._look()
        self._syncing = threading.Thread(target=self._sync, name="sync", daemon=True)
        self._syncing.start()

    def take_messages(self) -> bool:
        """Write what has come now and then: many messages cost little more than one."""
        took = super().take_messages()
        if time.monotonic() - self._taken >= _TAKE:
            self._taken = time.monotonic()
            self._take()
        return took

    # --- topics

    def _look(self) -> None:
        """Subscribe to further topics once they are there, with the quality of service that they offer."""
        for name in list(self._sought):
            full = self.resolve_topic_name(name)
            offers = self.get_publishers_info_by_topic(full)
            kind = self._kinds.get(name) or (offers[0].topic_type if offers else "")
            if not offers or not kind:
                continue
            self._sought.remove(name)
            try:
                message = message_class(kind)
            except InputError as error:
                self.get_logger().error(f"topic {name} can't be recorded: {error}")
                continue
            self._subscribe(name, message, kind, offered(offers, self.value("depth")))
        self._list_published()

    def _list_published(self) -> None:
        """Make the topics known to the bag on which somebody publishes."""
        with self._lock:
            for name, stream in self._streams.items():
                if self._bag is None or stream.listed or not self.get_publishers_info_by_topic(name):
                    continue
                try:
                    self._list(self._bag, stream)
                except RobotIdentError as error:
                    self.fail(error)

    def _subscribe(self, name: str, message: type, kind: str, profile: QoSProfile) -> None:
        full = self.resolve_topic_name(name)
        if full in self._hearings:
            return
        definition, type_hash = definition_of(kind)
        topic = Topic(full, kind, definition=definition, type_hash=type_hash)
        fields = message.get_fields_and_field_types()  # type: ignore[attr-defined]
        stream = Stream(topic, next(iter(fields.values()), "") == "std_msgs/Header")
        with self._lock:
            self._streams[full] = stream
        self._hearings[full] = Hearing(self, message, name, profile, raw=True)

    # --- recording

    def _start(self) -> None:
        """Open the bag; InputError when it can't be."""
        output = Path(self.value("output") or time.strftime("robot_ident_%Y_%m_%d-%H_%M_%S"))
        if output.exists():
            raise InputError(f"parameter output: {output} exists already; give another name")
        with self._lock:
            streams = {name: Stream(stream.topic, stream.has_header) for name, stream in self._streams.items()}
            bag = BagWriter(output, compress=self.value("compress"))
            self._streams, self._bag = streams, bag
            self._held.clear()
            self._begun = self._file_begun = time.monotonic()
            self._split_at = (self.value("split_size") * 1_000_000, self.value("split_duration"))
        self.get_logger().info(f"recording to {output}")

    def _stop(self) -> str:
        """Close the bag; return what it holds."""
        self._take(last=True)
        with self._lock:
            bag, self._bag = self._bag, None
            if bag is None:
                return ""
            bag.custom_data |= {f"robot_ident{name}": stream.summary() for name, stream in self._streams.items()}
            try:
                for stream in self._streams.values():
                    if not stream.listed:
                        self._list(bag, stream)
            finally:
                bag.close()
        counts = ", ".join(f"{stream.stamps.received} of {name}" for name, stream in self._streams.items())
        return f"{bag.path}: {bag.messages} messages ({counts})"

    def _take(self, *, last: bool = False) -> None:
        """Take what has come and write it in the order in which it came; last: all of it.

        What is received while the topics are emptied one after the other waits until the next time.
        """
        until = time.time_ns()
        for name, hearing in self._hearings.items():
            for data, info in hearing.waiting(until):
                received = info["received_timestamp"] or time.time_ns()
                number = info["publication_sequence_number"] or 0
                self._held.append(_Message(name, data, received, info["source_timestamp"] or received, number))
        self._held.sort(key=lambda message: message.received)
        ready = [message for message in self._held if last or message.received <= until]
        if self._held:
            self._newest_ns = max(self._newest_ns, self._held[-1].received)
        del self._held[: len(ready)]
        with self._lock:
            bag = self._bag
            if bag is None:
                return
            try:
                for message in ready:
                    self._write(bag, message)
                now = time.monotonic()
                if last or now - self._flushed >= _FLUSH:
                    bag.flush()
                    self._flushed = now
            except RobotIdentError as error:
                self.fail(error)

    def _write(self, bag: BagWriter, message: _Message) -> None:
        stream = self._streams[message.stream]
        if not stream.listed:
            self._list(bag, stream)
        late = self._written_ns - message.received
        logged = self._written_ns if 0 < late < _ORDERED else message.received  # else the clock was set
        self._written_ns = logged
        bag.write(message.stream, message.data, logged, message.sent, message.number % 2**32)
        size, duration = self._split_at
        now = time.monotonic()
        if (size and bag.file_bytes >= size) or (duration and now - self._file_begun >= duration):
            bag.split()
            self._file_begun = now
        stream.stamps.add(header_stamp(message.data) if stream.has_header else message.sent)
        if message.number:
            stream.numbers.add(message.number)

    def _list(self, bag: BagWriter, stream: Stream) -> None:
        """Make a topic known to the bag, with what its publishers offer by now, or what we ask for."""
        name = stream.topic.name
        profiles = [offer.qos_profile for offer in self.get_publishers_info_by_topic(name)]
        qos = qos_text([qos_of(profile) for profile in profiles or [self._hearings[name].profile]])
        bag.add_topic(replace(stream.topic, qos=qos))
        stream.listed = True

    def _sync(self) -> None:
        """Bring what was written to the disk, so that a power cut takes no more than a second of it."""
        while not self._end.wait(_SYNC):
            bag = self._bag
            if bag is not None:
                try:
                    bag.sync()
                except RobotIdentError as error:
                    self.fail(error)
                except ValueError:
                    continue  # the bag was closed meanwhile

    # --- services and status

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            if self._bag is not None:
                raise InputError(f"recording already, to {self._bag.path}")
            self._start()
            response.success, response.message = True, f"recording to {self._bag.path if self._bag else ''}"
        except RobotIdentError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            text = self._stop()
            response.success, response.message = bool(text), text or "nothing is being recorded"
        except RobotIdentError as error:  # the disk has no room for the end
            response.success, response.message = False, str(error)
            self.fail(error)
        return response

    def _tell(self) -> None:
        bag = self._bag
        if bag is None:
            self.tell(OK, "not recording", {})
            return
        if not bag.path.exists():
            self.fail(InputError(f"{bag.path}: was removed while it was being recorded; what it held is lost"))
            return
        left = shutil.disk_usage(bag.path).free
        lost = sum(stream.numbers.lost for stream in self._streams.values())
        gaps = sum(stream.stamps.gaps for stream in self._streams.values())
        values: dict[str, object] = {
            "output": bag.path,
            "messages": bag.messages,
            "duration [s]": f"{time.monotonic() - self._begun:.1f}",
            "disk left [MB]": left // 1_000_000,
        }
        values |= {name: stream.summary() for name, stream in self._streams.items()}
        message = "recording" if not lost else f"recording; {lost} messages were lost on the way"
        if left < 50_000_000:
            message = f"recording; only {left // 1_000_000} MB are left on the disk"
        elif self._sought:
            message += f"; nobody publishes on {', '.join(map(self.resolve_topic_name, self._sought))} yet"
        level = ERROR if left < 50_000_000 else WARN if lost or gaps or self._sought else OK
        self.tell(level, message, values)

    def _drain(self) -> None:
        """Take what had come before the end and the middleware has not handed out."""
        until_ns, deadline = time.time_ns(), time.monotonic() + _DRAIN
        idle, newest = 0, self._newest_ns
        while idle < _IDLE and newest < until_ns and time.monotonic() < deadline:
            time.sleep(_TAKE / 2)
            self._take()
            idle, newest = (0 if self._newest_ns != newest else idle + 1), self._newest_ns

    def close(self) -> None:
        """Close the bag properly."""
        self._drain()
        self.end()
        self._syncing.join()
        text = self._stop()
        if text:
            self.get_logger().info(text)


main = partial(run, Recorder)

if __name__ == "__main__":
    raise SystemExit(main())
