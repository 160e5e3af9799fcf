"""Acquisition times, converted between ISO 8601 and NumPy."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Any

import numpy as np

Time = np.datetime64


def time_of_text(text: str | None) -> Time | None:
    """Parses an ISO 8601 time, in UTC; `None` if it is invalid. A year or a month is its first
    instant.
    """
    if text is None:
        return None
    text = text.strip()
    try:
        if re.fullmatch(r"\d{4}(-\d{2})?", text):
            return np.datetime64(text, "ns")
        if not re.match(r"\d{4}", text):
            return None
        # (Python's datetime has microseconds at most.)
        whole, fraction, zone = _divided(text)
        at = datetime.fromisoformat(whole + zone)
    except ValueError:
        return None
    if at.tzinfo is not None:
        at = at.astimezone(UTC).replace(tzinfo=None)
    found = np.datetime64(at, "ns")
    # (datetime64[ns] only has the years 1678 to 2261.)
    if found.astype("M8[s]").item() != at:
        return None
    return found + np.timedelta64(fraction, "ns")


def _divided(text: str) -> tuple[str, int, str]:
    """Splits a time into integer seconds, nanoseconds, and the time zone that follows."""
    found = re.fullmatch(r"([^.,]*)[.,](\d+)(.*)", text)
    if found is None:
        return text, 0, ""
    whole, digits, zone = found.groups()
    return whole, int(digits[:9].ljust(9, "0")), zone


def text_of_time(time: Any) -> str:
    """Formats a datetime64 in ISO 8601, with as many digits as it needs."""
    at = np.datetime64(time, "ns")
    if np.isnat(at):
        raise ValueError("time: got NaT, expected a time")
    text = str(np.datetime_as_string(at, unit="ns"))
    return text.rstrip("0").rstrip(".") + "Z" if "." in text else text + "Z"


def short_of(text: str) -> str:
    """Formats a time in letters and digits, for layer names that need no quotes in expressions:
    `20240105`, `20240105T101500`.
    """
    digits = text.replace("-", "").replace(":", "").replace(".", "_").removesuffix("Z")
    return digits.removesuffix("T000000")


def group_of(name: str, text: str) -> str:
    """Returns a layer's name without its time, in any of its formats; empty if the name is only a
    time.
    """
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
