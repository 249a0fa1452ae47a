"""Attitude Ephemeris Messages (AEM) of CCSDS 504.0-B-2 in keyword-value notation; those of B-1 are read as well.

The standard's quaternion "from A to B" turns the axes of A into those of B, as q_ab turns those of a into those of b.
Its scalar part is the last number. Angular velocities are in deg/s.
"""

import math
import re
from datetime import UTC, date, datetime, timedelta
from decimal import Context, Decimal
from pathlib import Path

import numpy as np

from rbfmu.on_disk import replacing
from rbfmu.types import Array

DAY, NOON, SECONDS = date(2000, 1, 1), 43200, 86400
EPOCH = f"{DAY}T12:00:00"
"""The date that is written for a scene's time 0, since scenes have no date."""
WIDTHS = {"QUATERNION": 4, "QUATERNION/DERIVATIVE": 8, "QUATERNION/ANGVEL": 7, "QUATERNION/RATE": 7}
"""The numbers in a line, by ATTITUDE_TYPE. Derivatives are not read, nor the rates of B-1, which are not the body's."""
EXACT = Context(prec=400)
"""Enough digits for exact sums of any times; the usual 28 lose the last digits of fractions of a microsecond."""
TOLERANCE = 1e-3
"""The largest difference from 1 of the square of a quaternion's length, as files may have few digits."""
ON_BODY = r"(ACC|ACTUATOR|AST|CSS|DSS|ESA|GYRO|IMU_FRAME|INSTRUMENT|MTA|RW|SA|SC_BODY|SENSOR|STARTRACKER|TAM)([_ \d]|$)"
"""How the names begin that CCSDS gives to frames which are fixed in a spacecraft."""
_TIME = re.compile(r"(\d{4})-(?:(\d\d)-(\d\d)|(\d{3}))T([01]\d|2[0-3]):([0-5]\d):((?:[0-5]\d|60)(?:\.\d*)?)Z?")
_ORIGIN = re.compile(rf"COMMENT .*time 0 of the scene is ({_TIME.pattern})")


def write_aem(path: Path, time: Array, quaternion: Array, omega_b: Array | None) -> None:
    """Write q_ab (n, 4) at times (n), s, and omega_ab_b (n, 3), rad/s, if it is known, with every digit.

    A number may have 17 digits, as other programs write too; the standard allows 16. Raises ValueError for a
    quaternion that is not of length 1, and for a time whose date is not representable.
    """
    if bad := np.flatnonzero(np.abs(np.sum(quaternion * quaternion, axis=1) - 1.0) > TOLERANCE).tolist():
        raise ValueError(f"quaternion = {quaternion[bad[0]].tolist()} in row {bad[0] + 1}: expected one of length 1")
    epochs = [_epoch(t) for t in time.tolist()]
    columns = np.roll(quaternion, -1, axis=1)
    kind = ["ATTITUDE_TYPE = QUATERNION"]
    if omega_b is not None:
        columns = np.hstack([columns, np.degrees(omega_b)])
        kind = ["ATTITUDE_TYPE = QUATERNION/ANGVEL", "ANGVEL_FRAME = SC_BODY_1"]
    head = [
        "CCSDS_AEM_VERS = 2.0", f"CREATION_DATE = {datetime.now(UTC):%Y-%m-%dT%H:%M:%S}", "ORIGINATOR = RBFMU", "",
        "META_START", f"COMMENT rbfmu: time 0 of the scene is {EPOCH}",
        "COMMENT EME2000 stands for the scene's inertial frame a, SC_BODY_1 for the body's frame b",
        f"OBJECT_NAME = {path.stem.upper()}", "OBJECT_ID = UNKNOWN", "REF_FRAME_A = EME2000", "REF_FRAME_B = SC_BODY_1",
        "TIME_SYSTEM = UTC", f"START_TIME = {epochs[0]}", f"STOP_TIME = {epochs[-1]}", *kind, "META_STOP", "",
    ]  # fmt: skip
    with replacing(path, "w", encoding="ascii", errors="replace") as file:
        file.writelines(f"{line}\n" for line in [*head, "DATA_START"])
        rows = zip(epochs, (columns + 0.0).tolist(), strict=True)  # the standard has no -0
        file.writelines(f"{epoch} {' '.join(map(_number, row))}\n" for epoch, row in rows)
        file.write("DATA_STOP\n")


def read_aem(path: Path) -> dict[str, Array]:
    """Return time (n), s, quaternion q_ab (n, 4), and omega_a or omega_b (n, 3), rad/s, if all lines have it.

    Frame b is REF_FRAME_B, or REF_FRAME_A if only that is the spacecraft's; a is the other one. Time 0 is that of the
    first line, or that of the scene in files of `write_aem`. Segments are joined; where one begins at the very time at
    which the one before it ends, as the standard allows, its line counts. Leap seconds are not counted. Raises
    ValueError with file, line, and what was expected.
    """
    origin: Decimal | None = None
    meta, begins = dict[str, str](), True
    rows: list[tuple[Decimal, list[float], str, list[float]]] = []
    lines = [line.strip() for line in path.read_text(encoding="utf-8-sig", errors="replace").splitlines()]
    number, first = next(((n, line) for n, line in enumerate(lines, 1) if line), (1, ""))
    try:
        if not re.match(r"CCSDS_AEM_VERS\s*=\s*[0-2]\.", first):
            raise ValueError(f"{first[:60]!r}: expected CCSDS_AEM_VERS = 2.0 or 1.0, in keyword-value notation")
        for number, line in enumerate(lines, 1):  # noqa: B007 - an error names it
            key, equals, value = map(str.strip, line.partition("="))
            if found := _ORIGIN.match(line):
                origin = _seconds(found[1])
            elif line == "META_START":
                meta, begins = {}, True
            elif equals and begins:
                meta[key] = value.upper()
            elif line and line.split()[0] not in ("COMMENT", "META_STOP", "DATA_START", "DATA_STOP"):
                row = _row(line.split(), meta)
                if begins and rows and rows[-1][0] == row[0]:
                    rows.pop()
                rows.append(row)
                begins = False
        if not rows:
            raise ValueError("expected lines of attitudes")
        if lines.count("DATA_START") > lines.count("DATA_STOP"):  # else a last number that is cut short would be read
            raise ValueError("expected DATA_STOP after the attitudes; the file has been cut short")
    except ValueError as error:
        raise ValueError(f"{path}: line {number}: {error}") from None
    times, attitudes, names, rates = zip(*rows, strict=True)
    start = times[0] if origin is None else origin
    columns = {"time": np.array([float(EXACT.subtract(t, start)) for t in times]), "quaternion": np.array(attitudes)}
    if names[0] and len({*names}) == 1:
        columns[names[0]] = np.radians(rates)
    return columns


def _row(words: list[str], meta: dict[str, str]) -> tuple[Decimal, list[float], str, list[float]]:
    """Return (time, q_ab, name of the angular velocity, its numbers in deg/s); without it, the last two are empty."""
    if missing := [key for key in ("REF_FRAME_A", "REF_FRAME_B", "ATTITUDE_TYPE") if key not in meta]:
        raise ValueError(f"{missing[0]} is missing before the first attitude")
    kind, a, b = (meta[key] for key in ("ATTITUDE_TYPE", "REF_FRAME_A", "REF_FRAME_B"))
    if kind not in WIDTHS:
        raise ValueError(f"ATTITUDE_TYPE = {kind}: expected one of {', '.join(WIDTHS)}")
    if len(words) != 1 + WIDTHS[kind]:
        raise ValueError(f"expected a time and {WIDTHS[kind]} numbers, as ATTITUDE_TYPE = {kind} has")
    numbers = [float(word) for word in words[1:]]
    q = numbers[:4] if meta.get("QUATERNION_TYPE") == "FIRST" else [numbers[3], *numbers[:3]]
    if not abs(math.fsum(x * x for x in q) - 1.0) <= TOLERANCE:
        raise ValueError(f"quaternion {' '.join(words[1:5])}: expected one of length 1")
    from_body = bool(re.match(ON_BODY, a)) and not re.match(ON_BODY, b)
    if from_body != (meta.get("ATTITUDE_DIR") == "B2A"):
        q[1:] = [-x for x in q[1:]]
    frame = {"REF_FRAME_A": a, "REF_FRAME_B": b}.get(meta.get("ANGVEL_FRAME", ""), meta.get("ANGVEL_FRAME"))
    if kind != "QUATERNION/ANGVEL" or frame not in (a, b):
        return _seconds(words[0]), q, "", []
    rate = [-x for x in numbers[4:]] if from_body else numbers[4:]
    return _seconds(words[0]), q, "omega_b" if (frame == b) != from_body else "omega_a", rate


def _seconds(text: str) -> Decimal:
    """Return the seconds from `EPOCH` to a time such as 2000-01-01T12:00:00.5 or 2000-001T12:00:00.5."""
    if not (found := _TIME.fullmatch(text)):
        raise ValueError(f"{text!r}: expected a time such as {EPOCH}.25")
    year, month, day, of_year, hour, minute, second = found.groups()
    there, later = date(int(year), int(month or 1), int(day or 1)), timedelta(int(of_year or 1) - 1)
    if not timedelta() <= later <= date(int(year), 12, 31) - there:
        raise ValueError(f"{text!r}: expected a day of {year}")
    days = (there + later - DAY).days
    return EXACT.add(Decimal(SECONDS * days + 3600 * int(hour) + 60 * int(minute) - NOON), Decimal(second))


def _epoch(t: float) -> str:
    """Return the date and time t s after `EPOCH`, with the decimals from which t is read back exactly."""
    after = EXACT.add(Decimal(repr(t)), Decimal(NOON))
    days = math.floor(after / SECONDS)
    minutes, second = EXACT.divmod(EXACT.subtract(after, Decimal(SECONDS * days)), Decimal(60))
    try:
        day = DAY + timedelta(days)
    except OverflowError:
        raise ValueError(f"time = {t!r} s: expected one within some thousand years of {EPOCH}") from None
    return f"{day}T{int(minutes) // 60:02d}:{int(minutes) % 60:02d}:{'0' * (second < 10)}{second:f}"


def _number(x: float) -> str:
    """Return a number with every digit, and with a decimal point even before an exponent."""
    text = repr(x)
    return text if "." in text else text.replace("e", ".0e")
