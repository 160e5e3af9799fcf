//! Amounts, as people write and read them.

/// Parses a number of bytes: `256M`, `1G`, `1GiB`, `1000000`. Units are powers of 1024.
pub(crate) fn parse_bytes(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let digits = text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.').len();
    let (number, unit) = text.split_at(digits);
    let power = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 0,
        "k" | "kb" | "kib" => 1,
        "m" | "mb" | "mib" => 2,
        "g" | "gb" | "gib" => 3,
        "t" | "tb" | "tib" => 4,
        _ => return Err("the unit should be K, M, G or T".into()),
    };
    let number: f64 = number.parse().map_err(|_| "expected a number such as 256M or 1G")?;
    let bytes = number * 1024f64.powi(power);
    if !(1.0..=1e18).contains(&bytes) { Err("out of range".into()) } else { Ok(bytes as u64) }
}

/// Bytes with three digits or so: `14.8 MiB`.
pub(crate) fn bytes(bytes: u64) -> String {
    let units = ["bytes", "KiB", "MiB", "GiB", "TiB", "PiB"];
    scaled(bytes as f64, 1024.0, &units)
}

/// A count with three digits or so: `1.24 billion`.
pub(crate) fn count(number: f64) -> String {
    scaled(number, 1000.0, &["", "thousand", "million", "billion", "trillion"])
}

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
    fn bytes_are_read() {
        for (text, expected) in [
            ("1", 1),
            ("1000000", 1_000_000),
            ("256M", 256 << 20),
            ("1G", 1 << 30),
            ("1GiB", 1 << 30),
            ("1gb", 1 << 30),
            ("1.5 k", 1536),
            ("2T", 2 << 40),
            ("7B", 7),
        ] {
            assert_eq!(parse_bytes(text), Ok(expected), "{text}");
        }
        for text in ["", "M", "0", "-1", "1X", "1iB", "1e9", "1.2.3", "9999999T", "1 0"] {
            assert!(parse_bytes(text).is_err(), "{text}");
        }
    }

    #[test]
    fn amounts_are_written() {
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
