"""Two network namespaces with a cable between them, which can be pulled: a robot's and its computer's."""

from __future__ import annotations

import os
import shutil
import subprocess

MULTICAST = "224.0.0.0/4"


def available() -> bool:
    """Return whether namespaces can be made here (root, and a kernel that lets it)."""
    if os.geteuid() != 0 or shutil.which("ip") is None:
        return False
    probe = f"probe{os.getpid()}"
    if subprocess.run(["ip", "netns", "add", probe], capture_output=True, check=False).returncode:
        return False
    subprocess.run(["ip", "netns", "del", probe], check=False)
    return True


class Cable:
    """A veth pair between the namespaces `robot` and `computer`."""

    def __init__(self) -> None:
        """Make both and plug it in."""
        self.robot, self.computer = (f"{name}{os.getpid()}" for name in ("robot", "computer"))
        for space in (self.robot, self.computer):
            self._ip("netns", "add", space)
        self._ip("link", "add", "cable", "netns", self.robot, "type", "veth", "peer", "cable", "netns", self.computer)
        for number, space in enumerate((self.robot, self.computer), start=1):
            self._ip("-n", space, "link", "set", "lo", "up")
            self._ip("-n", space, "addr", "add", f"10.97.53.{number}/24", "dev", "cable")
        self.plug()

    def plug(self) -> None:
        """Connect both sides."""
        for space in (self.robot, self.computer):
            self._ip("-n", space, "link", "set", "cable", "up")
            self._ip("-n", space, "route", "replace", MULTICAST, "dev", "cable")

    def pull(self) -> None:
        """Cut the connection."""
        self._ip("-n", self.computer, "link", "set", "cable", "down")

    def inside(self, space: str) -> tuple[str, ...]:
        """Return the words before a command that is to run in a namespace, over UDP alone."""
        over_udp = ("FASTDDS_BUILTIN_TRANSPORTS=UDPv4", "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET")
        return ("ip", "netns", "exec", space, "env", *over_udp)

    def close(self) -> None:
        """Remove both; the cable goes with them."""
        for space in (self.robot, self.computer):
            subprocess.run(["ip", "netns", "del", space], check=False)

    @staticmethod
    def _ip(*words: str) -> None:
        subprocess.run(["ip", *words], check=True)
