//! Times of layers.

use std::path::PathBuf;

use super::StackLayer;
use spinney_base::{Error, Result};

/// Tells layers their times: one of each, or those of the files that they are from.
pub(super) fn give(layers: &mut [StackLayer], files: &[PathBuf], times: &[String]) -> Result<()> {
    if let Some(time) = times.iter().find(|time| !is_time(time)) {
        let expected = "times as ISO 8601 writes them: 2024, 2024-05, 2024-05-31 or 2024-05-31T10:30:00Z";
        return Err(Error::invalid("times", format!("`{time}`"), expected));
    }
    if times.len() == layers.len() {
        layers.iter_mut().zip(times).for_each(|(layer, time)| layer.metadata.time = Some(time.clone()));
        return Ok(());
    }
    if times.len() != files.len() {
        let expected = format!("one for each of {} layers or {} files", layers.len(), files.len());
        return Err(Error::invalid("times", times.len().to_string(), expected));
    }
    for layer in layers {
        let file = files.iter().position(|file| *file == layer.path);
        layer.metadata.time = file.map(|file| times[file].clone());
    }
    Ok(())
}

/// Whether a text is a time as ISO 8601 writes it: a year, month or day, or a day with a time, which may have a fraction and a zone.
fn is_time(text: &str) -> bool {
    let is = |text: &str, pattern: &str| {
        let fits = |(found, expected): (char, char)| match expected {
            '0' => found.is_ascii_digit(),
            expected => found == expected,
        };
        text.chars().count() == pattern.len() && text.chars().zip(pattern.chars()).all(fits)
    };
    let Some((day, time)) = text.split_once('T') else {
        return ["0000", "0000-00", "0000-00-00"].iter().any(|pattern| is(text, pattern));
    };
    let (time, zone) = time.split_at(time.find(['Z', '+', '-']).unwrap_or(time.len()));
    let (time, fraction) = time.split_once('.').unwrap_or((time, "0"));
    is(day, "0000-00-00")
        && ["00:00", "00:00:00"].iter().any(|pattern| is(time, pattern))
        && fraction.chars().all(|digit| digit.is_ascii_digit())
        && ["", "Z", "+00:00", "-00:00"].iter().any(|pattern| is(zone, pattern))
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
}
