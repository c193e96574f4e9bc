"""Why a scan of a log or a message is left out."""

from enum import StrEnum


class Reason(StrEnum):
    """A reason in the words of a message: "3 scans without a pose"."""

    NO_TIME = "without a time"
    NOT_LATER = "not later than the one before"
    TOO_SOON = "less than half a step after the one before"
    OUT_OF_ORDER = "with a time out of order"
    NO_POSE = "without a pose"
    FAR_POSE = "with a pose that is too far away to be one"
    TILTED = "of a lidar that is tilted too far to be horizontal"
    NO_BEAMS = "without beams"
    OTHER_BEAMS = "with another number of beams"
    OTHER_ANGLES = "with other beam angles"
    UNKNOWN_ANGLES = "with a number of readings that does not tell their angles, as 180 or 361 does"
    CONTRADICTION = "with angles that contradict one another"
    NO_RANGE = "without a valid maximum range"
    OTHER_RANGE = "with another maximum range, which range_max_m replaces"
    NOT_METERS = "with ranges that are not in meters"
    NO_READING = "without a valid reading"
