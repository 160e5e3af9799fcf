"""Times of what is seen, between ISO 8601 and NumPy."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Any

import numpy as np

Time = np.datetime64


def time_of_text(text: str | None) -> Time | None:
    """The time of a text as ISO 8601 has it, in UTC; `None` if it is none. Years and months are their beginnings."""
    if text is None:
        return None
    text = text.strip()
    try:
        if re.fullmatch(r"\d{4}(-\d{2})?", text):
            return np.datetime64(text, "ns")
        if not re.match(r"\d{4}", text):
            return None
        # (Python knows microseconds at most.)
        whole, fraction, zone = _divided(text)
        at = datetime.fromisoformat(whole + zone)
    except ValueError:
        return None
    if at.tzinfo is not None:
        at = at.astimezone(UTC).replace(tzinfo=None)
    found = np.datetime64(at, "ns")
    # (Nanoseconds know the years 1678 to 2261 alone.)
    if found.astype("M8[s]").item() != at:
        return None
    return found + np.timedelta64(fraction, "ns")


def _divided(text: str) -> tuple[str, int, str]:
    """A time up to whole seconds, its nanoseconds, and the zone behind them."""
    found = re.fullmatch(r"([^.,]*)[.,](\d+)(.*)", text)
    if found is None:
        return text, 0, ""
    whole, digits, zone = found.groups()
    return whole, int(digits[:9].ljust(9, "0")), zone


def text_of_time(time: Any) -> str:
    """A time of datetime64 as ISO 8601 has it, with as many digits as it needs."""
    at = np.datetime64(time, "ns")
    if np.isnat(at):
        raise ValueError("time: NaT is no time")
    text = str(np.datetime_as_string(at, unit="ns"))
    return text.rstrip("0").rstrip(".") + "Z" if "." in text else text + "Z"


def short_of(text: str) -> str:
    """A time in letters and digits, which a layer's name may have without being quoted in expressions: `20240105`, `20240105T101500`."""
    digits = text.replace("-", "").replace(":", "").replace(".", "_").removesuffix("Z")
    return digits.removesuffix("T000000")


def group_of(name: str, text: str) -> str:
    """A layer's name without its time, however that is written in it; empty if it is all."""
    at = time_of_text(text)
    forms = {text, text.removesuffix("Z"), short_of(text)}
    if at is not None:
        whole = text_of_time(at)
        forms |= {whole, whole.removesuffix("Z"), short_of(whole), short_of(whole) + "Z"}
        if whole.endswith("T00:00:00Z"):
            forms |= {whole[:10], whole[:10].replace("-", "")}
    for form in sorted(forms, key=len, reverse=True):
        if form and form in name:
            before, _, after = name.partition(form)
            before, after = before.rstrip("_-. @"), after.lstrip("_-. @")
            return f"{before}_{after}" if before and after else before or after
    return name
