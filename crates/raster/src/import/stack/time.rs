//! Times of layers.

use std::path::PathBuf;

use super::StackLayer;
use spinney_base::{Error, Result};

/// Assigns times to layers: one per layer, or those of the files that they come from.
pub(super) fn give(layers: &mut [StackLayer], files: &[PathBuf], times: &[String]) -> Result<()> {
    if let Some(time) = times.iter().find(|time| !is_time(time)) {
        let expected = "valid dates or times in ISO 8601: 2024, 2024-05, 2024-05-31 or 2024-05-31T10:30:00Z";
        return Err(Error::invalid("times", format!("`{time}`"), expected));
    }
    if times.len() == layers.len() {
        layers.iter_mut().zip(times).for_each(|(layer, time)| layer.metadata.time = Some(time.clone()));
        return Ok(());
    }
    if times.len() != files.len() {
        let expected = format!("one for each of {} layers, or of {} files", layers.len(), files.len());
        return Err(Error::invalid("times", times.len().to_string(), expected));
    }
    for layer in layers {
        let file = files.iter().position(|file| *file == layer.path);
        layer.metadata.time = file.map(|file| times[file].clone());
    }
    Ok(())
}

/// Whether a string is an ISO 8601 time: a year, month or day, or a day with a time, which may have
/// a fraction and a zone.
pub(crate) fn is_time(text: &str) -> bool {
    let Some((day, time)) = text.split_once('T') else {
        let parts: Vec<&str> = text.split('-').collect();
        return is_date(&parts);
    };
    let (time, zone) = time.split_at(time.find(['Z', '+', '-']).unwrap_or(time.len()));
    let (time, fraction) = time.split_once('.').unwrap_or((time, "0"));
    let (day, time): (Vec<&str>, Vec<&str>) = (day.split('-').collect(), time.split(':').collect());
    day.len() == 3
        && is_date(&day)
        && (2..=3).contains(&time.len())
        && is_time_of_day(&time)
        && !fraction.is_empty()
        && fraction.bytes().all(|digit| digit.is_ascii_digit())
        && match zone.split_at_checked(1) {
            None => true,
            Some(("Z", rest)) => rest.is_empty(),
            Some((_, offset)) => {
                let offset: Vec<&str> = offset.split(':').collect();
                offset.len() == 2 && is_time_of_day(&offset)
            }
        }
}

/// Parses a number of exactly `digits` digits.
fn number(text: &str, digits: usize) -> Option<u32> {
    let is_number = text.len() == digits && text.bytes().all(|digit| digit.is_ascii_digit());
    is_number.then(|| text.parse().ok()).flatten()
}

/// Whether a year, a year and a month, or all three, are a date of the Gregorian calendar.
fn is_date(parts: &[&str]) -> bool {
    let (Some(year), months) = (number(parts[0], 4), parts.get(1).map(|month| number(month, 2))) else {
        return false;
    };
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let days = match months {
        None => 0,
        Some(Some(2)) => 28 + u32::from(leap),
        Some(Some(4 | 6 | 9 | 11)) => 30,
        Some(Some(1..=12)) => 31,
        Some(_) => return false,
    };
    let day = parts.get(2).map(|day| number(day, 2));
    parts.len() <= 3 && day.is_none_or(|day| day.is_some_and(|day| (1..=days).contains(&day)))
}

/// Whether hours, minutes and optional seconds are a time of day; 60 seconds are a leap second.
fn is_time_of_day(parts: &[&str]) -> bool {
    let limits = [23, 59, 60];
    parts.iter().zip(limits).all(|(part, limit)| number(part, 2).is_some_and(|number| number <= limit))
}

#[cfg(test)]
mod tests {
    use super::is_time;

    #[test]
    fn times_are_those_of_iso_8601() {
        let good = ["2024", "2024-05", "2024-05-31", "2024-05-31T10:30", "2024-05-31T10:30:00.25Z"];
        assert!(good.iter().all(|text| is_time(text)) && is_time("2024-05-31T10:30:00-05:00"));
        let bad =
            ["", "May 2024", "2024-5-1", "20240531", "2024-05-31 10:30", "2024-05T10:30", "2024-05-31T1é:30"];
        assert!(bad.iter().all(|text| !is_time(text)));
    }

    #[test]
    fn invalid_dates_and_times_are_rejected() {
        let good = [
            "2024-02-29",
            "2000-02-29",
            "2024-12-31T23:59:60Z",
            "2024-01-01T00:00",
            "2024-01-01T00:00+14:00",
        ];
        assert!(good.iter().all(|text| is_time(text)));
        let bad = [
            "2024-13-01",
            "2024-00",
            "2024-01-00",
            "2024-01-32",
            "2024-04-31",
            "2023-02-29",
            "1900-02-29",
            "2024-01-01T25:00",
            "2024-01-01T23:60",
            "2024-01-01T23:59:61",
            "2024-01-01T10",
            "2024-01-01T10:00.",
            "2024-01-01T10:00+25:00",
            "2024-01-01T10:00Zulu",
            "2024-01-01-01",
            "2024-",
            "-2024",
        ];
        let accepted: Vec<&&str> = bad.iter().filter(|text| is_time(text)).collect();
        assert!(accepted.is_empty(), "{accepted:?}");
    }
}
