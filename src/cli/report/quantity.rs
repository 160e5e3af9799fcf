//! Quantities, formatted for people.

/// Formats bytes with about three digits: `14.8 MiB`.
pub(crate) fn bytes(bytes: u64) -> String {
    let units = ["bytes", "KiB", "MiB", "GiB", "TiB", "PiB"];
    scaled(bytes as f64, 1024.0, &units)
}

/// Formats a count with about three digits: `1.24 billion`.
pub(crate) fn count(number: f64) -> String {
    scaled(number, 1000.0, &["", "thousand", "million", "billion", "trillion"])
}

/// Formats a number of things, `1 level` or `2 levels`.
pub(crate) fn counted(number: u64, one: &str) -> String {
    format!("{number} {one}{}", if number == 1 { "" } else { "s" })
}

/// Formats a time, in seconds since 1970-01-01 00:00 UTC, in UTC: `2026-11-21 18:33:40`. (Converts
/// days to dates by Hinnant's algorithm.)
pub(crate) fn time(seconds: i64) -> String {
    let (days, rest) = (seconds.div_euclid(86400), seconds.rem_euclid(86400));
    // Years begin in March, so that a leap day is a year's last; 400 years have 146097 days.
    let days = days.saturating_add(719_468);
    let (era, day) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let (year, month) =
        (year + era * 400 + i64::from(month > 9), if month > 9 { month - 9 } else { month + 3 });
    let (hour, minute, second) = (rest / 3600, rest / 60 % 60, rest % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02}")
}

/// Formats a number in the largest unit in which it is not below 1, or rounds to 1.
fn scaled(mut number: f64, base: f64, units: &[&str]) -> String {
    let mut unit = 0;
    // 999.5 would be written as 1000.
    while number >= base - 0.5 && unit + 1 < units.len() {
        number /= base;
        unit += 1;
    }
    let digits = if unit == 0 || number >= 99.95 {
        0
    } else if number >= 9.995 {
        1
    } else {
        2
    };
    format!("{number:.digits$} {}", units[unit]).trim_end().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_written() {
        for (seconds, expected) in [
            (0, "1970-01-01 00:00:00"),
            (951_782_399, "2000-02-28 23:59:59"),
            (951_782_400, "2000-02-29 00:00:00"),
            (951_868_800, "2000-03-01 00:00:00"),
            (1_795_286_020, "2026-11-21 18:33:40"),
            (-1, "1969-12-31 23:59:59"),
        ] {
            assert_eq!(time(seconds), expected);
        }
        assert!(time(i64::MAX).ends_with(":07"));
    }

    #[test]
    fn quantities_are_formatted() {
        assert_eq!([0, 1, 2].map(|number| counted(number, "level")), ["0 levels", "1 level", "2 levels"]);
        assert_eq!(bytes(0), "0 bytes");
        assert_eq!(bytes(1023), "1023 bytes");
        assert_eq!(bytes(1536), "1.50 KiB");
        assert_eq!(bytes(15_518_925), "14.8 MiB");
        assert_eq!(bytes(300 << 20), "300 MiB");
        assert_eq!(count(999.0), "999");
        assert_eq!(count(999_600.0), "1.00 million");
        assert_eq!(count(1_240_000_000.0), "1.24 billion");
    }
}
