"""Quality of service of a topic, as rosbag2 notes it in a channel and in `metadata.yaml` (version 9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

_LONGEST = 1 << 16  # characters; a profile takes 400
FOREVER_NS = 2**63 - 1  # how ROS 2 writes "no limit"
# the numbers that bags before metadata version 9 write, in the order of rmw/types.h
_WORDS = {
    "history": ("system_default", "keep_last", "keep_all", "unknown"),
    "reliability": ("system_default", "reliable", "best_effort", "unknown", "best_available"),
    "durability": ("system_default", "transient_local", "volatile", "unknown", "best_available"),
    "liveliness": ("system_default", "automatic", "manual_by_node", "manual_by_topic", "unknown", "best_available"),
}


@dataclass(frozen=True)
class Qos:
    """One offered profile, in the words of `ros2 topic info --verbose`; times in ns."""

    history: str = "keep_last"
    depth: int = 10
    reliability: str = "reliable"
    durability: str = "volatile"
    deadline_ns: int = FOREVER_NS
    lifespan_ns: int = FOREVER_NS
    liveliness: str = "automatic"
    liveliness_lease_duration_ns: int = FOREVER_NS
    avoid_ros_namespace_conventions: bool = False

    def mapping(self) -> dict[str, Any]:
        """Return the keys and values that rosbag2 writes."""

        def duration(nanoseconds: int) -> dict[str, int]:
            return dict(zip(("sec", "nsec"), divmod(nanoseconds, 1_000_000_000), strict=True))

        return {
            "history": self.history,
            "depth": self.depth,
            "reliability": self.reliability,
            "durability": self.durability,
            "deadline": duration(self.deadline_ns),
            "lifespan": duration(self.lifespan_ns),
            "liveliness": self.liveliness,
            "liveliness_lease_duration": duration(self.liveliness_lease_duration_ns),
            "avoid_ros_namespace_conventions": self.avoid_ros_namespace_conventions,
        }


def qos_text(profiles: Sequence[Qos | dict[str, Any]]) -> str:
    """Return the YAML text that stands in a channel's `offered_qos_profiles`."""
    import yaml

    mappings = [profile.mapping() if isinstance(profile, Qos) else profile for profile in profiles]
    return str(yaml.safe_dump(mappings, sort_keys=False)).strip() if mappings else ""


def profiles_of(text: str) -> list[dict[str, Any]]:
    """Return the profiles of a channel's text in the words of version 9; none where the text is no list of profiles."""
    from robot_ident.configuration import NotYaml, load_yaml

    try:
        profiles = load_yaml(text) if text and len(text) <= _LONGEST else []
    except NotYaml:
        return []
    if not isinstance(profiles, list) or not all(isinstance(profile, dict) for profile in profiles):
        return []
    for profile in profiles:
        for key, words in _WORDS.items():
            number = profile.get(key)
            if isinstance(number, int):
                profile[key] = words[number] if 0 <= number < len(words) else "unknown"
    return list(profiles)
